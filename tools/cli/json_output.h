// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// JSON that a command writes. JSON has neither infinity nor NaN, and its texts are UTF-8.

#include <jansson.h>
#include <stdbool.h>
#include <stddef.h>

// Sets a member to a path, as printf; null if that is not UTF-8.
void json_set_path(json_t *object, const char *name, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
// A text, such as a path or the name of an image; null if it is NULL or not UTF-8.
json_t *json_text(const char *text);
// The first bytes of a message. If it is not UTF-8, '?' replaces the bytes outside of ASCII.
json_t *json_message(const char *text, size_t length);
// The texts of the elements of a list, joined by commas. text_of returns memory for free(), or NULL
// for an empty text. Release with free().
char *json_joined(const json_t *list, char *(*text_of)(const json_t *value));
// A number, or null for infinity and NaN.
json_t *json_number(double value);

// Writes indented JSON with numbers of 9 digits and a final newline. Steals the reference to
// `root`. False after printing the error.
bool write_json(const char *path, json_t *root);
// A copy with numbers as write_json stores them. NULL without memory.
json_t *json_as_stored(const json_t *value);
