# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# NAME.html of FOLDER with NAME.css and the scripts of FOLDER in place of their comments, as the C string SYMBOL in OUT.
# Scripts are inserted in alphabetical order.
file(READ "${FOLDER}/${NAME}.html" page)
file(READ "${FOLDER}/${NAME}.css" style)
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
file(WRITE "${OUT}" "extern const char ${SYMBOL}[];\nconst char ${SYMBOL}[] = {${bytes}0};\n")
