#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# sparegs bd: the table formats that it accepts, N/A with its reason, and messages for bad input.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
a=$temporary/a.csv b=$temporary/b.csv
printf 'size,psnr\n10,20\n20,25\n40,29\n' >"$a"

# columns_are_found_by_name_in_any_order
printf 'name, PSNR ,"size"\r\nz,29,20\r\nx,20,5\r\n\r\ny,25,10' >"$b"
run 0 bd "$a" "$b" --json
json "$temporary/stdout" '(.bd_rate_percent + 50 | fabs) < 1e-6 and .bd_psnr_db > 4 and .bd_rate_reason == null'
run 0 bd "$a" "$b"
prints "BD-rate   -50.00 %"
prints "BD-PSNR   +4.49 dB"

# a_byte_order_mark_is_no_part_of_the_header
printf '\xef\xbb\xbfsize,psnr\r\n10,20\r\n20,25\r\n40,29\r\n' >"$b"
run 0 bd "$a" "$b"
prints "BD-rate   +0.00 %"

# commas_in_quotes_belong_to_the_field
printf 'name,"size",psnr\n"x, 8",5,20\n"a ""y"", b",10,25\n "z" ,20,29\n' >"$b"
run 0 bd "$a" "$b"
prints "BD-rate   -50.00 %"

# figures_without_a_common_range_are_null_with_a_reason
printf 'size,psnr\n10,30\n20,35\n40,39\n' >"$b"
run 0 bd "$a" "$b" --json
json "$temporary/stdout" '.bd_rate_percent == null and .bd_rate_reason == "the curves have no common range of PSNR" and .bd_psnr_db > 9'
run 0 bd "$a" "$b"
prints "BD-rate   N/A (the curves have no common range of PSNR)"
printf 'size,psnr\n10,30\n20,35\n40,34\n' >"$b"
run 0 bd "$a" "$b" --json
json "$temporary/stdout" '.bd_rate_percent == null and .bd_psnr_db == null'
prints "a smaller file is better by more than 0.02 dB"

# ties_are_reported
printf 'size,psnr\n10,20\n20,25\n40,25\n' >"$b"
run 0 bd "$a" "$b"
reports "warning: equal PSNRs or sizes within a curve were moved apart by 1e-9 (1 point); the result depends on their rounding"
one_line
run 0 bd "$b" "$b"
reports "(2 points)"
printf 'size,psnr\n10,20\n20,25\n20,25\n40,29\n' >"$b"
run 0 bd "$a" "$b" # moved in both directions
reports "(1 point)"

# a_narrow_common_range_of_psnr_is_reported
printf 'size,psnr\n10,28.9995\n20,35\n40,39\n' >"$b"
run 0 bd "$a" "$b"
prints "BD-rate   -75.00 %"
reports "warning: the PSNR ranges of the curves overlap by 0.0005 dB only; BD-rate depends on the rounding of the points"
one_line
run 0 bd "$a" "$b" --json
json "$temporary/stdout" '(.common_psnr_db - 0.0005 | fabs) < 1e-9'
printf 'size,psnr\n10,28.9\n20,35\n40,39\n' >"$b"
run 0 bd "$a" "$b"
check a_wider_range_is_not test ! -s "$temporary/stderr"

# one_table_of_several_curves: the column is bytes, as in post.csv; rows are selected by the values of columns
post=$temporary/post.csv
printf 'variant,step,bytes,psnr,note\noff,d,10,20,\non,d,5,20,\noff,d,20,25,\non,"d",10,25,"a, b"\n' >"$post"
printf 'off,d,40,29,\non, d,20,29,\non,c,1,x,\n' >>"$post"
run 0 bd "$post" "$post" --select variant=off --select-test Variant=on,step=d
prints "BD-rate   -50.00 %"
run 0 bd "$post" "$post" --select variant=off,note=
prints "BD-rate   +0.00 %"
run 1 bd "$post" "$post" --select variant=off --select-test variant=on
reports "post.csv: line 8: psnr is 'x'; a finite number is required"
one_line
run 1 bd "$post" "$post" --select variant=off --select-test variant=none
reports "post.csv: 0 rows with variant=none; at least 3 points of size and PSNR are required"
one_line
run 1 bd "$post" "$post" --select method=pup
reports "post.csv: line 1: the header has no column 'method' to select by"
one_line
for text in variant =off variant=off, ,variant=off; do
    run 2 bd "$post" "$post" --select "$text"
    reports "--select: '$text' is not COLUMN=VALUE[,COLUMN=VALUE...]"
    one_line
done
run 2 bd "$post" "$post" --select-test variant
reports "--select-test: 'variant' is not"

# sizes_in_MiB_are_compared_with_bytes: the curves of SOG on Mip-NeRF 360, published in MiB, either in bytes
printf 'size,psnr\n45.92,26.44\n39.28,25.98\n29.56,24.71\n' >"$a"
printf 'size,psnr\n28.13,26.25\n24.13,25.80\n18.18,24.49\n' >"$b"
awk -F, 'NR > 1 { $1 = sprintf("%.0f", $1 * 1048576) } NR == 1 { $1 = "bytes" } { print $1 "," $2 }' "$a" >"$temporary/a_bytes.csv"
awk -F, 'NR > 1 { $1 = sprintf("%.0f", $1 * 1048576) } NR == 1 { $1 = "bytes" } { print $1 "," $2 }' "$b" >"$temporary/b_bytes.csv"
run 0 bd "$a" "$b"
prints "BD-rate   -35.60 %"
check no_note_with_equal_columns test ! -s "$temporary/stderr"
run 0 bd "$a" "$temporary/b_bytes.csv"
prints "BD-rate   -35.60 %"
reports "$a: column 'size' is taken as MiB, because $temporary/b_bytes.csv has 'bytes'"
one_line
run 0 bd "$temporary/a_bytes.csv" "$b"
prints "BD-rate   -35.60 %"
reports "$b: column 'size' is taken as MiB, because $temporary/a_bytes.csv has 'bytes'"
# a_column_may_name_the_unit
sed 's/size/mib/' "$a" >"$temporary/a_mib.csv"
for other in "$b" "$temporary/b_bytes.csv"; do
    run 0 bd "$temporary/a_mib.csv" "$other"
    prints "BD-rate   -35.60 %"
done
check no_note_if_both_have_units test ! -s "$temporary/stderr"
run 0 bd "$b" "$temporary/a_mib.csv"
reports "$b: column 'size' is taken as MiB, because $temporary/a_mib.csv has 'MiB'"
one_line
printf 'size,psnr\n10,20\n20,25\n40,29\n' >"$a"

# bad_tables_are_refused
bad() { # MESSAGE: the printf format of the table is on stdin
    # shellcheck disable=SC2059 # a format
    printf "$(cat)" >"$b"
    run 1 bd "$a" "$b" --quiet
    reports "$1"
    one_line
}
bad "b.csv: 0 rows; at least 3" </dev/null
bad "b.csv: 2 rows; at least 3" <<<'size,psnr\n1,2\n2,3\n'
bad "b.csv: line 1: the header has no column 'size'" <<<'1,2\n2,3\n4,5\n'
bad "b.csv: line 1: the header has no column 'psnr'" <<<'size,dB\n1,2\n2,3\n'
bad "b.csv: line 3: psnr is 'x'; a finite number is required" <<<'size,psnr\n1,2\n2,x\n3,4\n'
bad "b.csv: line 2: psnr is ''; a finite number is required" <<<'size,psnr\n1\n2,3\n3,4\n'
bad "b.csv: line 2: psnr is 'inf'" <<<'size,psnr\n1,inf\n2,3\n3,4\n'
bad "b.csv: line 2: size is 'nan'" <<<'size,psnr\nnan,1\n2,3\n3,4\n'
bad "b.csv: line 2: size is '1 2'" <<<'size,psnr\n1 2,1\n2,3\n3,4\n'
bad "b.csv: line 4: size is 0; it must be positive" <<<'size,psnr\n1,1\n2,3\n0,4\n'
bad "b.csv: line 2: contains a NUL byte" <<<'size,psnr\n1\000,2\n2,3\n3,4\n'
for header in "a," ","; do
    awk -v field="$header" 'BEGIN { for (i = 0; i < 200000; ++i) printf "%s", field }' >"$b"
    run 1 bd "$a" "$b"
    reports "b.csv: line 1: is longer than"
done
awk 'BEGIN { print "size,psnr"; for (i = 0; i < 30000; ++i) printf "b,"; print "1,2" }' >"$b"
run 1 bd "$a" "$b"
reports "b.csv: line 2: size is 'b'"
run 1 bd /dev/zero "$a"
reports "/dev/zero"
run 1 bd "$a" "$temporary/nowhere.csv"
reports "nowhere.csv: No such file or directory"
mkfifo "$temporary/pipe.csv"
run 1 bd "$temporary/pipe.csv" "$a"
reports "pipe.csv: is not a regular file"
run 0 bd <(cat "$a") "$a" # a pipe of the shell
run 1 bd "$temporary" "$a"
reports "Is a directory"
run 2 bd "$a"

finish
