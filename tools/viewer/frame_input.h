// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Messages of a WebSocket client from its bytes (RFC 6455, section 5), which are untrusted. A frame
// is refused by its head, before its payload arrives. Without sockets.

#include <stdbool.h>
#include <stddef.h>

#include "viewer/view_message.h"

typedef enum frame_event {
    FRAME_NONE,  // the bytes so far contain no further message
    FRAME_TEXT,  // a whole message, from one frame or several
    FRAME_PING,  // payload of at most 125 bytes
    FRAME_PONG,  // likewise
    FRAME_CLOSE, // likewise
    FRAME_REFUSED
} frame_event;

// Status of a close frame for what is refused.
enum { CLOSE_PROTOCOL_ERROR = 1002, CLOSE_UNSUPPORTED_DATA = 1003, CLOSE_MESSAGE_TOO_BIG = 1009 };

// Zero-initialise.
typedef struct frame_input {
    int close_status;    // after FRAME_REFUSED
    bool has_part;       // frames of a message have arrived, not its last one
    size_t message_size; // of these frames
    unsigned char message[MESSAGE_BYTES];
    size_t taken, used; // bytes before `taken` are those of earlier frames
    unsigned char bytes[MESSAGE_BYTES + 14];
} frame_input;

// Where to write bytes that arrived, *room of them at most, at least one. Then call frame_input_add
// with their number, and frame_input_next until it returns FRAME_NONE.
unsigned char *frame_input_space(frame_input *input, size_t *room);
void frame_input_add(frame_input *input, size_t count);
// The next message; its payload is valid until the next call of these functions.
frame_event frame_input_next(frame_input *input, const unsigned char **payload, size_t *size);
// True if a frame or a message has begun and not ended.
bool frame_input_is_partial(const frame_input *input);
