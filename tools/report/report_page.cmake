# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# PAGE, an HTML file, as the C string report_page in OUT.
file(READ "${PAGE}" text HEX)
string(REGEX REPLACE "([0-9a-f][0-9a-f])" "0x\\1," bytes "${text}")
file(WRITE "${OUT}" "extern const char report_page[];\nconst char report_page[] = {${bytes}0};\n")
