# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# viewer_page.html of FOLDER with its style and scripts in place of their comments, as the C string viewer_page in OUT.
# Scripts are inserted in alphabetical order.
file(READ "${FOLDER}/viewer_page.html" page)
file(READ "${FOLDER}/viewer_page.css" style)
file(GLOB scripts "${FOLDER}/*.js")
list(SORT scripts)
set(script "")
foreach(file ${scripts})
    file(READ "${file}" text)
    string(APPEND script "${text}")
endforeach()
string(REPLACE "<!-- style -->" "${style}" page "${page}")
string(REPLACE "<!-- script -->" "${script}" page "${page}")
file(WRITE "${OUT}.html" "${page}")
file(READ "${OUT}.html" text HEX)
string(REGEX REPLACE "([0-9a-f][0-9a-f])" "0x\\1," bytes "${text}")
file(WRITE "${OUT}" "extern const char viewer_page[];\nconst char viewer_page[] = {${bytes}0};\n")
