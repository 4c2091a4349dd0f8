#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# `sparegs view` without a browser: who is served, what is served, pictures equal to those of `render`, pixels equal to
# the reference renderer, hostile input, the end of the server.
set -u
# shellcheck source-path=SCRIPTDIR source=../cli_support.sh
source "$SPAREGS_SOURCE/tests/cli/cli_support.sh"
client=$SPAREGS_SOURCE/tests/cli/pages/view_client.py

run 0 train "$room" -o "$temporary/run" --iterations 120 --downscale 4 --quiet
cp "$temporary"/run/point_cloud/iteration_120/point_cloud.ply "$temporary/model.ply"

# start ARGUMENT...: starts the program in the background; sets server and url.
start() {
    last_command="sparegs view $*"
    : >"$temporary/url"
    "$program" view "$@" >"$temporary/url" 2>"$temporary/stderr" &
    server=$!
    for _ in $(seq 600); do
        [ -s "$temporary/url" ] || ! kill -0 "$server" 2>/dev/null && break
        sleep 0.1
    done
    url=$(head -1 "$temporary/url")
    check prints_the_url grep -qxE 'http://[0-9a-z.-]+:[0-9]+/(\?token=[A-Za-z0-9_-]+)?' "$temporary/url"
}
# stop SIGNAL: the server ends with status 0.
stop() {
    local status=0
    kill "-$1" "$server"
    wait "$server" || status=$?
    check "$1_ends_with_status_0" test "$status" -eq 0
}
# code EXPECTED URL [CURL-OPTION...]: the status of a request.
code() {
    local expected=$1
    shift
    curl -s -o "$temporary/body" --path-as-is -w '%{http_code}' "$@" >"$temporary/code"
    check "status_${expected}_of: $*" grep -qx "$expected" "$temporary/code"
}
# page COMMAND...: runs the client; its lines are checks.
page() {
    local status=0
    python3 "$client" "$url" "$@" >"$temporary/page" 2>&1 || status=$?
    grep '^FAIL' "$temporary/page"
    check "client: $*" test "$status" -eq 0 -a "$(grep -c '^FAIL' "$temporary/page")" -eq 0
}

# the_address_is_printed_as_json_when_serving_starts
"$program" view "$temporary/run" --port 0 --json --quiet >"$temporary/url.json" 2>"$temporary/stderr" &
server=$!
last_command="sparegs view --json"
for _ in $(seq 600); do
    grep -q '^}' "$temporary/url.json" || ! kill -0 "$server" 2>/dev/null && break
    sleep 0.1
done
json "$temporary/url.json" 'keys == ["schema", "url"] and (.url | test("^http://127.0.0.1:[0-9]+/$"))'
code 200 "$(jq -r .url "$temporary/url.json")"
stop TERM
check one_object test "$(jq -s length "$temporary/url.json")" = 1

# ---- A run with its scene ----
start "$temporary/run" "$room" --port 0
curl -sD "$temporary/head" "$url" -o "$temporary/page.html"
check one_page test "$(tr -d '\r' <"$temporary/head" | head -1)" = "HTTP/1.1 200 OK"
for header in "content-security-policy: default-src 'none'; script-src 'nonce-" 'x-content-type-options: nosniff' \
    'x-frame-options: deny' 'cross-origin-resource-policy: same-origin' 'cache-control: no-store'; do
    check "header: $header" grep -qi "^$header" "$temporary/head"
done
check no_unsafe_policy bash -c "! grep -qi unsafe '$temporary/head'"
check nothing_from_other_hosts bash -c "! grep -oE '(src|href)=\"?(https?:)?//[^\" ]*|@import|url\(' '$temporary/page.html'"
nonce=$(grep -oiE "script-src 'nonce-[^']*" "$temporary/head" | sed "s/.*nonce-//")
check the_page_has_the_nonce test "$(grep -c "nonce=\"$nonce\"" "$temporary/page.html")" -eq 2
curl -sD "$temporary/head2" "$url" -o /dev/null
check the_nonce_changes bash -c "! grep -q '$nonce' '$temporary/head2'"

base=${url%/}
code 200 "$base/photo/0" -D "$temporary/head"
check a_photo_is_a_png bash -c "grep -qi '^content-type: image/png' '$temporary/head' &&
    head -c 4 '$temporary/body' | od -An -tx1 | grep -q '89 50 4e 47'"
mv "$temporary/body" "$temporary/photo.png"
code 200 "$base/thumb/1" -D "$temporary/head"
check a_thumbnail_is_a_jpeg bash -c "grep -qi '^content-type: image/jpeg' '$temporary/head' &&
    head -c 3 '$temporary/body' | od -An -tx1 | grep -q 'ff d8 ff'"
code 404 "$base/photo/100000"
code 404 "$base/photo/0.png"
code 404 "$base/nothing"
code 405 "$base/" -X POST -d x
code 405 "$base/" -X PUT -d x
code 426 "$base/stream"
for path in /../../etc/passwd /%2e%2e/%2e%2e/etc/passwd /photo/../../../etc/passwd //etc/passwd /..%2f..%2fetc/passwd \
    '/photo/0%00.txt' /.git/config /config.json /photo/; do
    curl -s --path-as-is "$base$path" -o "$temporary/body"
    check "no_file: $path" bash -c "! grep -q 'root:\|\"options\"' '$temporary/body'"
done
code 403 "$base/" -H 'Host: evil.example'
check the_options_of_both_commands_are_named grep -qF 'set a token (--token, or --view-token of train) and forward' "$temporary/body"
code 403 "$base/" -H "Host: evil.example:${base##*:}"
code 403 "$base/" -H 'Origin: http://evil.example'
code 403 "$base/photo/0" -H 'Origin: null'
code 200 "$base/" -H 'Host: localhost:9999' -H 'Origin: http://localhost:9999'
handshake() { python3 "$client" "$1" status "${@:2}"; } # URL HEADER...
check a_handshake_of_another_origin_is_refused test "$(python3 - "$SPAREGS_SOURCE/tests/cli/pages" "$base" <<'PY'
import sys
sys.path.insert(0, sys.argv[1])
from websocket_client import WebSocket
host, port = sys.argv[2].split("//")[1].split(":")
print(WebSocket(host, int(port), "/stream", origin="http://evil.example").status, WebSocket(host, int(port), "/stream").status)
PY
)" = "403 101"

# at_rest_pictures_equal_render: bit for bit.
mkdir "$temporary/pictures"
page pictures "$temporary/pictures"
name=$(basename "$(jq -r '.[0].img_name' "$temporary/run/cameras.json")")
first=$(python3 - "$SPAREGS_SOURCE/tests/cli/pages" "$url" <<'PY'
import sys
sys.path.insert(0, sys.argv[1])
from view_client import Page
page = Page(sys.argv[2])
print(page.wait("hello")["views"][0]["name"])
PY
)
check the_first_view_has_a_name test -n "$first" -a -n "$name"
equal() { check "the_picture_equals_render: $1" oiiotool "$1" "$2" --fail 0 --warn 0 --diff; }
served=$last_command
run 0 eval "$temporary/run" "$room" --split all --save "$temporary/scored" --quiet
equal "$temporary/photo.png" "$temporary/scored/${first%.*}_photo.png"
run 0 render "$temporary/run" "$room" --view "$first" --format png --aov rgba,normal -o "$temporary/drawn" --quiet
equal "$temporary/pictures/view.png" "$temporary/drawn/${first%.*}.png"
equal "$temporary/pictures/normal.png" "$temporary/drawn/${first%.*}.normal.png"
run 0 render "$temporary/run" --camera "$temporary/pictures/free.json" --format png --aov rgba -o "$temporary/drawn_free" --quiet
equal "$temporary/pictures/free.png" "$temporary/drawn_free/frame_00000.png"
run 0 render "$temporary/run" "$room" --view "$first" --format png --aov rgba --spp 4 -o "$temporary/drawn_spp" --quiet
equal "$temporary/pictures/samples.png" "$(find "$temporary/drawn_spp" -name '*.png')"

# pixels_equal_render: the values of all AOVs at some pixels are those of the EXR, and the hits sum up to them.
run 0 render "$temporary/run" "$room" --view "$first" --aov all --exr-encoding srgb --compression none -o "$temporary/exr" --quiet
exr=$(find "$temporary/exr" -name '*.exr')
for k in 0 1 2; do
    jq -c ".pixels[$k].probe" "$temporary/pictures/pixels.json" >"$temporary/probe.json"
    x=$(jq .x "$temporary/probe.json") y=$(jq .y "$temporary/probe.json")
    numbers=$(oiiotool "$exr" --ch depth.Z,depth_median.Z,depth_first.Z,transmittance.T,R,G,B --cut "1x1+$x+$y" --printstats |
        sed -n 's/.*Stats Avg: *\([^(]*[0-9]\) *(.*/\1/p' | tr -s ' ' ',')
    check "values_of_the_pixel_$x,$y" jq -e --argjson exr "[$numbers]" '($exr | length) == 7 and
        ([.depth, .depth_median, .depth_first, .transmittance] + .rgba | . as $seen
        | [$exr, $seen] | transpose | all((.[0] - .[1] | fabs) <= 2e-6 * (1 + (.[0] | fabs))))' "$temporary/probe.json"
done
check the_ray_explains_the_pixel jq -e '.pixels | all((.ray.transmittance - .probe.transmittance | fabs) < 1e-4
    and .ray.count == .probe.hits and ((.ray.hits | length) == .ray.count)
    and ((.ray.hits | map(.t)) as $t | $t == ($t | sort))
    and (.ray.hits | all((.weight - .alpha * .transmittance | fabs) < 1e-12)))' "$temporary/pictures/pixels.json"
check there_are_hits jq -e '[.pixels[].ray.count] | max > 3' "$temporary/pictures/pixels.json"

# a_crop_is_the_file_of_convert
last_command=$served
read -r cropped filters < <(python3 "$client" "$url" crop 2>&1)
check a_crop_is_saved test -s "$cropped"
# shellcheck disable=SC2086 # several options
run 0 convert "$temporary/run" "$temporary/converted.ply" $filters --quiet
check the_crop_is_the_file_of_convert cmp "$cropped" "$temporary/converted.ply"

last_command=$served
page progressive
page many
page never_reads
if is_long; then
    page frames
    page idle
    page stalled 9 # seconds; the limit is 5, rounded up to even seconds
fi
page hostile
page storm 1000
check serves_after_all_that test "$(curl -s -o /dev/null -w '%{http_code}' "$url")" = 200
stop TERM
check nothing_but_the_url_on_stdout test "$(wc -l <"$temporary/url")" -eq 1
check files_of_the_run_are_unchanged cmp "$temporary/model.ply" "$temporary/run/point_cloud/iteration_120/point_cloud.ply"

# a_crop_has_the_marks_of_the_view, and so has the file of the command
start "$temporary/model.ply" "$room" --port 0 --filter mip --train-space linear --white 4
served=$last_command
read -r cropped filters < <(python3 "$client" "$url" crop 2>&1)
stop TERM
check the_crop_is_marked grep -aqx 'comment SplatRenderMode: mip' "$cropped"
# shellcheck disable=SC2086 # several options
run 0 convert "$temporary/model.ply" "$temporary/converted.ply" $filters --quiet
check the_crop_is_the_file_of_convert cmp "$cropped" "$temporary/converted.ply"
last_command=$served

# a_crop_has_the_marks_of_the_run_that_is_given, not those of the file, and so has the file of the command
mkdir "$temporary/of"
cp -r "$temporary/run" "$temporary/mip"
jq '.options.filter = "mip"' "$temporary/run/config.json" >"$temporary/mip/config.json"
run 0 convert "$temporary/model.ply" "$temporary/of/plain.ply" --quiet
run 0 convert "$temporary/model.ply" "$temporary/of/marked.ply" --antialiased on --train-space linear --white 4 --quiet
declare -A marks=([plain]=1 [marked]=0)
for pair in plain:mip marked:run; do
    start "$temporary/of/${pair%:*}.ply" "$room" --port 0 --run "$temporary/${pair#*:}"
    served=$last_command
    read -r cropped filters < <(python3 "$client" "$url" crop 2>&1)
    stop TERM
    check "the_mark_is_that_of_the_run: $pair" test "$(grep -acx 'comment SplatRenderMode: mip' "$cropped")" = "${marks[${pair%:*}]}"
    # shellcheck disable=SC2086 # several options
    run 0 convert "$temporary/of/${pair%:*}.ply" "$temporary/converted.ply" $filters --quiet
    check "the_crop_is_the_file_of_convert: $pair" cmp "$cropped" "$temporary/converted.ply"
done
last_command=$served

# ---- Photos in linear light ----
# A scene of three photos as EXR files eight times as bright, written by oiiotool.
hdr=$temporary/hdr
mkdir -p "$hdr/images" "$temporary/ldr"
cp -r "$room/sparse" "$hdr/"
for name in 0001 0002 0003; do
    oiiotool "$room/images/$name.jpg" -o "$temporary/ldr/$name.png"
    oiiotool "$temporary/ldr/$name.png" --colorconvert sRGB linear --mulc 8 -d half -o "$hdr/images/$name.exr"
done
# shown OUT ARGUMENT...: the first photo.
shown() {
    start "${@:2}" --port 0
    curl -s "${url%/}/photo/0" -o "$1"
    check no_option_is_idle bash -c "! grep 'no effect' '$temporary/stderr'"
    stop INT
}
# near NAME A B: within one level of 255 (powf and half floats).
near() { check "$1" oiiotool "$2" "$3" --fail 0.0045 --diff; }
shown "$temporary/bright.png" "$temporary/model.ply" "$hdr" --white 8
near white_is_applied "$temporary/bright.png" "$temporary/ldr/0001.png"
shown "$temporary/measured.png" "$temporary/model.ply" "$hdr" --train-space linear
run 0 eval "$temporary/model.ply" "$hdr" --train-space linear --split all --save "$temporary/measured" --quiet
equal "$temporary/measured.png" "$temporary/measured/0001_photo.png"
shown "$temporary/declared.png" "$temporary/model.ply" "$room" --input-colorspace linear --white 1
oiiotool "$room/images/0001.jpg" --iscolorspace linear --colorconvert linear sRGB -d uint8 -o "$temporary/encoded.png"
near input_colorspace_is_applied "$temporary/declared.png" "$temporary/encoded.png"

# ---- A token ----
start "$temporary/model.ply" --port 0 --token a-token-of-this-test
code 401 "${url%%\?*}"
code 401 "${url%%\?*}?token=another-token-here"
code 401 "${url%%\?*}photo/0"
check no_handshake_without_token test "$(handshake "${url%%\?*}")" = 401
code 200 "$url"
check a_cookie_is_set bash -c "curl -si '$url' | grep -qi '^set-cookie: .*HttpOnly; SameSite=Strict'"
check handshake_with_token test "$(handshake "$url")" = 101
cookie=$(curl -si "$url" | sed -n 's/^[Ss]et-[Cc]ookie: \([^;]*\);.*/\1/p')
check the_cookie_has_the_token grep -qxE "sparegs_view_$(sed -E 's/.*:([0-9]+).*/\1/' <<<"$url")_[0-9a-f]{8}=a-token-of-this-test" <<<"$cookie"
check handshake_with_cookie test "$(handshake "${url%%\?*}" "Cookie: $cookie")" = 101
# A reverse proxy: its host, and its origin.
code 200 "$url" -H 'Host: view.example' -D "$temporary/head"
check the_cookie_is_that_of_the_path bash -c "! grep -qi '^set-cookie: .*path=' '$temporary/head'"
code 401 "${url%%\?*}" -H 'Host: view.example'
check a_handshake_by_a_proxy test "$(handshake "$url" 'Host: view.example' 'Origin: https://view.example')" = 101
check a_handshake_by_a_proxy_of_another_host test "$(handshake "$url" 'X-Forwarded-Host: view.example' 'Origin: https://view.example')" = 101
check no_handshake_of_another_origin test "$(handshake "$url" 'X-Forwarded-Host: view.example' 'Origin: https://evil.example')" = 403
check no_handshake_by_a_proxy_without_token test "$(handshake "${url%%\?*}" 'Host: view.example' 'Origin: https://view.example')" = 401
code 200 "$url" -H 'X-Forwarded-Host: view.example' -D "$temporary/head"
check the_policy_names_the_proxy grep -qi '^content-security-policy: .* wss://view.example;' "$temporary/head"
stop INT
# The command line is readable for all users, the environment is not.
start "$temporary/model.ply" --port 0 --token random
check a_random_token_is_in_the_url grep -qE '/\?token=[A-Za-z0-9_-]{32}$' "$temporary/url"
check the_command_line_does_not_have_it bash -c "! tr '\\0' ' ' </proc/$server/cmdline | grep -qF '${url#*token=}'"
code 401 "${url%%\?*}"
code 200 "$url"
earlier=$url
stop TERM
export SPAREGS_TOKEN=token-of-the-environment
start "$temporary/model.ply" --port 0
check the_variable_is_the_token grep -q '?token=token-of-the-environment$' "$temporary/url"
code 401 "${url%%\?*}"
code 200 "$url"
stop TERM
SPAREGS_TOKEN=random start "$temporary/model.ply" --port 0
check the_variable_may_be_random grep -qE '/\?token=[A-Za-z0-9_-]{32}$' "$temporary/url"
check tokens_differ test "${url#*token=}" != "${earlier#*token=}"
stop TERM
start "$temporary/model.ply" --port 0 --token token-of-the-option
check the_option_comes_first grep -q '?token=token-of-the-option$' "$temporary/url"
stop TERM
SPAREGS_TOKEN=short run 2 view "$temporary/model.ply"
reports "SPAREGS_TOKEN: must be"
SPAREGS_TOKEN=short run 2 train "$room" -o "$temporary/none" --view 0
reports "SPAREGS_TOKEN: must be"
SPAREGS_TOKEN='' start "$temporary/model.ply" --port 0
check an_empty_variable_is_none bash -c "! grep -q token '$temporary/url'"
stop TERM
unset SPAREGS_TOKEN
start "$temporary/model.ply" --port 0 --address 0.0.0.0
check another_address_has_a_random_token grep -qE '\?token=[A-Za-z0-9_-]{32}$' "$temporary/url"
# ---- Errors: the port of this server ----
port=$(sed -E 's/.*:([0-9]+).*/\1/' <<<"$url")
other=$server
run 1 view "$temporary/model.ply" --port "$port"
one_line
reports "port $port of 127.0.0.1 is in use"
server=$other
last_command="sparegs view"
stop TERM
run 1 view "$temporary/model.ply" --port 0 --address 192.0.2.77
one_line
reports "192.0.2.77 is not an address of this machine"
run 2 view "$temporary/model.ply" --address nowhere
reports "--address: 'nowhere' is not a numeric IPv4 address"
run 2 view "$temporary/model.ply" --token short
reports "--token: must be"
run 1 view "$temporary/missing.ply" --port 0
one_line
run 2 view
mkdir -p "$temporary/gone" && cp -r "$room"/. "$temporary/gone" && find "$temporary/gone" -name '*.jpg' -o -name '*.png' -o -name '*.JPG' | xargs rm -f
run 1 view "$temporary/model.ply" "$temporary/gone" --port 0
check one_error test "$(grep -c '^sparegs: ' "$temporary/stderr")" -ge 1

finish
