// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// A film of pictures, made by ffmpeg as a child process that reads raw frames from a pipe.

#include <stdbool.h>

#include "sparegs/scene.h"

typedef struct video video;

// True if ffmpeg is installed; else the error was printed.
bool video_possible(void);

// Starts ffmpeg for `path`, whose ending tells the format. NULL after printing the error.
video *video_open(const char *path, int width, int height, double fps);
// Appends a picture of 3 planes, of the size above. False after printing the error.
bool video_add(video *film, const sgs_image8 *image);
// Waits for ffmpeg, puts the film in its place and prints its path on stdout; unless `complete`,
// leaves none. False after printing the error. Accepts NULL.
bool video_close(video *film, bool complete);
