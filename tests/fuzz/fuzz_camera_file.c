// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// cameras.json, or with FUZZ_CHAN a .chan file, as read by `render --camera` (tools/cameras, linked
// with the error functions below instead of the program's). Checks that errors name the file and
// accepted cameras are valid with finite poses.

#include <stdarg.h>

#include "cameras/camera_file.h"
#include "cameras/chan_file.h"
#include "fuzz_support.h"

static char message[2048];

int fail_run(const char *format, ...);
char *format_text(const char *format, ...);

int fail_run(const char *format, ...)
{
    va_list args;
    va_start(args, format);
    vsnprintf(message, sizeof message, format, args);
    va_end(args);
    return 1;
}

char *format_text(const char *format, ...)
{
    char *text = NULL;
    va_list args;
    va_start(args, format);
    FUZZ_REQUIRE(vasprintf(&text, format, args) >= 0);
    va_end(args);
    return text;
}

static bool read_list(const char *path, camera_list *list)
{
#ifdef FUZZ_CHAN
    return chan_file_read(path, 64, 48, list);
#else
    return camera_file_read(path, 0, list);
#endif
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const char *path = fuzz_file("input", data, size);
    camera_list list;
    if (!read_list(path, &list)) {
        FUZZ_REQUIRE(strstr(message, path) && !list.cameras && !list.count);
        return 0;
    }
    const named_camera *cameras = list.cameras;
    const size_t count = list.count;
    FUZZ_REQUIRE(count > 0 && count <= size);
    for (size_t i = 0; i < count; ++i) {
        FUZZ_REQUIRE(cameras[i].name && !sgs_camera_validate(&cameras[i].camera));
        for (int k = 0; k < 3; ++k)
            FUZZ_REQUIRE(isfinite(cameras[i].pose.translation[k]));
        for (int k = 0; k < 9; ++k)
            FUZZ_REQUIRE(isfinite(cameras[i].pose.rotation[k]));
    }
    camera_list_free(&list);
    return 0;
}
