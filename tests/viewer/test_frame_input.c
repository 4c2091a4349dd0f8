// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Frames of a WebSocket client: the examples of RFC 6455, section 5.7, whole and in any pieces, and
// what is refused.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "viewer/frame_input.h"

static frame_input *input_create(void)
{
    frame_input *input = calloc(1, sizeof *input);
    assert_non_null(input);
    return input;
}

static void add(frame_input *input, const void *bytes, size_t size)
{
    size_t room;
    unsigned char *space = frame_input_space(input, &room);
    assert_true(room >= size);
    memcpy(space, bytes, size);
    frame_input_add(input, size);
}

static void expect(frame_input *input, frame_event event, const void *bytes, size_t size)
{
    const unsigned char *payload;
    size_t found;
    assert_int_equal(frame_input_next(input, &payload, &found), event);
    if (event == FRAME_NONE || event == FRAME_REFUSED)
        return;
    assert_int_equal(found, size);
    assert_memory_equal(payload, bytes, size);
}

// The head of a masked frame with mask 0, whose payload is plain.
static size_t head_of(unsigned bits, uint64_t size, unsigned char head[14])
{
    const size_t extended = size < 126 ? 0 : size < 65536 ? 2 : 8;
    memset(head, 0, 14);
    head[0] = (unsigned char)bits;
    head[1] = (unsigned char)(0x80 | (extended == 0 ? size : extended == 2 ? 126 : 127));
    for (size_t i = 0; i < extended; ++i)
        head[2 + i] = (unsigned char)(size >> 8 * (extended - 1 - i));
    return 2 + extended + 4;
}

// "Hello" masked, a ping and a pong with it, "Hel" and "lo" in two frames around a ping, a close.
static const unsigned char stream[] = {
    0x81, 0x85, 0x37, 0xfa, 0x21, 0x3d, 0x7f, 0x9f, 0x4d, 0x51, 0x58, // of the RFC
    0x8a, 0x85, 0x37, 0xfa, 0x21, 0x3d, 0x7f, 0x9f, 0x4d, 0x51, 0x58, // likewise
    0x01, 0x83, 0x37, 0xfa, 0x21, 0x3d, 0x7f, 0x9f, 0x4d,             //
    0x89, 0x82, 0x00, 0x00, 0x00, 0x00, 'h',  'i',                    //
    0x80, 0x82, 0x00, 0x00, 0x00, 0x00, 'l',  'o',                    //
    0x81, 0x80, 0x01, 0x02, 0x03, 0x04,                               //
    0x88, 0x82, 0x00, 0x00, 0x00, 0x00, 0x03, 0xe8};

static void the_examples_of_the_rfc_are_read_in_any_pieces(void **state)
{
    (void)state;
    static const struct {
        frame_event event;
        const char *payload;
    } expected[] = {{FRAME_TEXT, "Hello"}, {FRAME_PONG, "Hello"}, {FRAME_PING, "hi"},
                    {FRAME_TEXT, "Hello"}, {FRAME_TEXT, ""},      {FRAME_CLOSE, "\x03\xe8"}};
    for (size_t piece = 1; piece <= sizeof stream; ++piece) {
        frame_input *input = input_create();
        size_t events = 0;
        for (size_t at = 0; at < sizeof stream; at += piece) {
            add(input, stream + at, at + piece < sizeof stream ? piece : sizeof stream - at);
            const unsigned char *payload;
            size_t size;
            for (frame_event event;
                 (event = frame_input_next(input, &payload, &size)) != FRAME_NONE; ++events) {
                assert_true(events < sizeof expected / sizeof *expected);
                assert_int_equal(event, expected[events].event);
                assert_int_equal(size, strlen(expected[events].payload));
                assert_memory_equal(payload, expected[events].payload, size);
            }
        }
        assert_int_equal(events, sizeof expected / sizeof *expected);
        assert_false(frame_input_is_partial(input));
        free(input);
    }
}

static void a_part_is_announced(void **state)
{
    (void)state;
    frame_input *input = input_create();
    assert_false(frame_input_is_partial(input));
    for (size_t i = 0; i < 11; ++i) {
        add(input, stream + i, 1);
        expect(input, i < 10 ? FRAME_NONE : FRAME_TEXT, "Hello", 5);
        assert_int_equal(frame_input_is_partial(input), i < 10);
    }
    add(input, stream + 22, 9); // the first of two frames
    expect(input, FRAME_NONE, NULL, 0);
    assert_true(frame_input_is_partial(input));
    free(input);
}

static void forbidden_frames_are_refused_by_their_head(void **state)
{
    (void)state;
    static const struct {
        unsigned bits;
        bool within; // a message of several frames
        uint64_t size;
        int status;
    } cases[] = {{0xc1, false, 1, 1002}, // reserved bits
                 {0xa1, false, 1, 1002},
                 {0x91, false, 1, 1002},
                 {0x83, false, 1, 1002}, // reserved opcodes
                 {0x87, false, 1, 1002},
                 {0x8b, false, 1, 1002},
                 {0x8f, false, 0, 1002},
                 {0x80, false, 1, 1002}, // continues nothing
                 {0x00, false, 1, 1002},
                 {0x81, true, 1, 1002}, // begins within another one
                 {0x82, true, 1, 1002},
                 {0x82, false, 1, 1003},
                 {0x02, false, 1, 1003},
                 {0x09, false, 1, 1002}, // control frames in parts, or long
                 {0x08, false, 1, 1002},
                 {0x89, false, 126, 1002},
                 {0x88, true, 200, 1002},
                 {0x81, false, MESSAGE_BYTES + 1, 1009},
                 {0x01, false, UINT64_C(1) << 62, 1009},
                 {0x81, false, UINT64_MAX, 1009},
                 {0x80, true, MESSAGE_BYTES, 1009}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        frame_input *input = input_create();
        unsigned char head[14];
        if (cases[i].within)
            add(input, "\x01\x81\0\0\0\0x", 7);
        add(input, head, head_of(cases[i].bits, cases[i].size, head)); // no payload
        expect(input, FRAME_REFUSED, NULL, 0);
        assert_int_equal(input->close_status, cases[i].status);
        expect(input, FRAME_REFUSED, NULL, 0);
        free(input);
    }
    frame_input *input = input_create();
    add(input, "\x81\x05Hello", 7); // not masked
    expect(input, FRAME_REFUSED, NULL, 0);
    assert_int_equal(input->close_status, 1002);
    free(input);
}

// Adds a frame of x in pieces.
static void add_frame(frame_input *input, unsigned bits, size_t size)
{
    unsigned char head[14];
    add(input, head, head_of(bits, size, head));
    while (size) {
        size_t room;
        unsigned char *space = frame_input_space(input, &room);
        room = room < size ? room : size;
        assert_true(room);
        memset(space, 'x', room);
        frame_input_add(input, room);
        size -= room;
    }
}

static void messages_have_up_to_64_kib_in_any_number_of_frames(void **state)
{
    (void)state;
    unsigned char *text = malloc(MESSAGE_BYTES);
    assert_non_null(text);
    memset(text, 'x', MESSAGE_BYTES);
    frame_input *input = input_create();
    for (int round = 0; round < 3; ++round) {
        add_frame(input, 0x81, MESSAGE_BYTES);
        expect(input, FRAME_TEXT, text, MESSAGE_BYTES);
        add_frame(input, 0x01, 0);
        for (int part = 0; part < 16; ++part) {
            expect(input, FRAME_NONE, NULL, 0);
            add_frame(input, part < 15 ? 0x00 : 0x80, MESSAGE_BYTES / 16);
        }
        expect(input, FRAME_TEXT, text, MESSAGE_BYTES);
    }
    add_frame(input, 0x01, MESSAGE_BYTES);
    expect(input, FRAME_NONE, NULL, 0);
    add(input, "\x80\x81\0\0\0\0", 6);
    expect(input, FRAME_REFUSED, NULL, 0);
    assert_int_equal(input->close_status, 1009);
    free(input);
    free(text);
}

static void arbitrary_input_yields_bounded_messages_or_an_error(void **state)
{
    (void)state;
    uint64_t random = 1;
    int refused = 0, read = 0;
    for (int round = 0; round < 2000; ++round) {
        frame_input *input = input_create();
        frame_event event = FRAME_NONE;
        for (int part = 0; part < 40 && event != FRAME_REFUSED; ++part) {
            unsigned char bytes[16];
            for (size_t i = 0; i < sizeof bytes; ++i) {
                random = random * 6364136223846793005U + 1442695040888963407U;
                bytes[i] = (unsigned char)(random >> 56);
            }
            if (round & 1) { // a likely head
                bytes[0] = (unsigned char)(0x81 ^ (bytes[0] & (part % 8 ? 0x88 : 0x80)));
                bytes[1] = (unsigned char)(0x80 | bytes[1] % 11);
            }
            add(input, bytes, sizeof bytes);
            const unsigned char *payload;
            size_t size;
            while ((event = frame_input_next(input, &payload, &size)) != FRAME_NONE &&
                   event != FRAME_REFUSED) {
                assert_true(size <= (event == FRAME_TEXT ? MESSAGE_BYTES : 125));
                ++read;
            }
        }
        refused += event == FRAME_REFUSED;
        free(input);
    }
    assert_true(refused > 1000 && read > 500);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_examples_of_the_rfc_are_read_in_any_pieces),
        cmocka_unit_test(a_part_is_announced),
        cmocka_unit_test(forbidden_frames_are_refused_by_their_head),
        cmocka_unit_test(messages_have_up_to_64_kib_in_any_number_of_frames),
        cmocka_unit_test(arbitrary_input_yields_bounded_messages_or_an_error),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
