// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The version of these headers, for #if. sgs_version (runtime.h) is the version of the library that
// is linked. Semantic versioning: before 1.0.0 a minor version may change the API. CMakeLists.txt
// reads the three numbers from here.

#define SGS_VERSION_MAJOR 0
#define SGS_VERSION_MINOR 1
#define SGS_VERSION_PATCH 0

#define SGS_VERSION_TEXT_(major, minor, patch) #major "." #minor "." #patch
#define SGS_VERSION_TEXT(major, minor, patch) SGS_VERSION_TEXT_(major, minor, patch)
// "0.1.0"
#define SGS_VERSION SGS_VERSION_TEXT(SGS_VERSION_MAJOR, SGS_VERSION_MINOR, SGS_VERSION_PATCH)
