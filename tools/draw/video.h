// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Encodes a video with ffmpeg, run as a child process that reads raw frames from a pipe.

#include <stdbool.h>

#include "sparegs/scene.h"

typedef struct video video;

// True if ffmpeg is installed. False after printing the error.
bool video_possible(void);

// Starts ffmpeg for `path`, whose extension determines the format. aspect: width of a pixel over
// its height. NULL after printing the error.
video *video_open(const char *path, int width, int height, double aspect, double fps);
// Appends a frame with 3 channels of the size given to video_open. False after printing the error.
bool video_add(video *film, const sgs_image8 *image);
// Completes the video and prints its path, or discards it if `complete` is false. False after
// printing the error: ffmpeg has failed. Accepts NULL.
bool video_close(video *film, bool complete);
