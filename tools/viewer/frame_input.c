// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "viewer/frame_input.h"

#include <stdint.h>
#include <string.h>

enum {
    OPCODE_CONTINUATION = 0,
    OPCODE_TEXT = 1,
    OPCODE_BINARY = 2,
    OPCODE_CLOSE = 8,
    OPCODE_PING = 9,
    OPCODE_PONG = 10,
    FINAL = 0x80,
    RESERVED = 0x70,
    OPCODE = 0x0f,
    MASKED = 0x80,
    CONTROL_BYTES = 125,
    MASK_BYTES = 4
};

unsigned char *frame_input_space(frame_input *input, size_t *room)
{
    memmove(input->bytes, input->bytes + input->taken, input->used - input->taken);
    input->used -= input->taken;
    input->taken = 0;
    *room = sizeof input->bytes - input->used;
    return input->bytes + input->used;
}

void frame_input_add(frame_input *input, size_t count)
{
    input->used += count;
}

bool frame_input_is_partial(const frame_input *input)
{
    return input->has_part || input->used > input->taken;
}

// 0, or the status for a frame with this head.
static int refusal(const frame_input *input, unsigned bits, bool is_masked, uint64_t size)
{
    const unsigned opcode = bits & OPCODE;
    const bool is_control = opcode >= OPCODE_CLOSE;
    if (bits & RESERVED || !is_masked || opcode > OPCODE_PONG ||
        (opcode > OPCODE_BINARY && opcode < OPCODE_CLOSE))
        return CLOSE_PROTOCOL_ERROR;
    if (is_control)
        return bits & FINAL && size <= CONTROL_BYTES ? 0 : CLOSE_PROTOCOL_ERROR;
    if (input->has_part != (opcode == OPCODE_CONTINUATION))
        return CLOSE_PROTOCOL_ERROR;
    if (opcode == OPCODE_BINARY)
        return CLOSE_UNSUPPORTED_DATA;
    return size <= MESSAGE_BYTES - input->message_size ? 0 : CLOSE_MESSAGE_TOO_BIG;
}

// Appends a frame to the message. True if it is the last one.
static bool append(frame_input *input, unsigned bits, const unsigned char *payload, size_t size)
{
    memcpy(input->message + input->message_size, payload, size);
    input->message_size += size;
    input->has_part = !(bits & FINAL);
    return !input->has_part;
}

frame_event frame_input_next(frame_input *input, const unsigned char **payload, size_t *size)
{
    if (input->close_status)
        return FRAME_REFUSED;
    if (!input->has_part)
        input->message_size = 0;
    for (;;) {
        unsigned char *at = input->bytes + input->taken;
        const size_t left = input->used - input->taken;
        if (left < 2)
            return FRAME_NONE;
        const unsigned bits = at[0], shortest = at[1] & 0x7fU;
        const size_t extended = shortest < 126 ? 0 : shortest == 126 ? 2 : 8;
        if (left < 2 + extended)
            return FRAME_NONE;
        uint64_t length = extended ? 0 : shortest;
        for (size_t i = 0; i < extended; ++i)
            length = length << 8 | at[2 + i];
        input->close_status = refusal(input, bits, at[1] & MASKED, length);
        if (input->close_status)
            return FRAME_REFUSED;
        const size_t head = 2 + extended + MASK_BYTES;
        if (left < head + length)
            return FRAME_NONE;
        unsigned char *data = at + head;
        for (size_t i = 0; i < length; ++i)
            data[i] ^= at[head - MASK_BYTES + i % MASK_BYTES];
        input->taken += head + (size_t)length;
        const unsigned opcode = bits & OPCODE;
        if (opcode >= OPCODE_CLOSE) {
            *payload = data;
            *size = (size_t)length;
            return opcode == OPCODE_CLOSE  ? FRAME_CLOSE
                   : opcode == OPCODE_PING ? FRAME_PING
                                           : FRAME_PONG;
        }
        if (append(input, bits, data, (size_t)length)) {
            *payload = input->message;
            *size = input->message_size;
            return FRAME_TEXT;
        }
    }
}
