// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// One of CivetWeb's threads reads from each connection, the hub's own threads send. CivetWeb does
// the handshake and writes frames, but reads frames of up to 2 GiB and waits for the rest of one
// without limit. It also gives up sending after its time limit, in the middle of a message. Frames
// are therefore read here, and the socket is shut down after a part of a message: nothing else can
// follow, and the thread that reads ends. The socket, which CivetWeb does not report, is found by
// the address of the page.

#include "viewer/view_stream.h"

#include <arpa/inet.h>
#include <errno.h>
#include <math.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>

#include "cli/progress.h"
#include "viewer/frame_input.h"

enum {
    MESSAGE_SECONDS = 10, // from the first byte of a message to its last
    PING_SECONDS = 10,    // after the last byte
    SILENT_SECONDS = 60,  // pages answer pings
    DRAIN_SECONDS = 1
};

// Status of a close frame: RFC 6455, section 7.4.1, and its registry.
enum { CLOSE_NORMAL = 1000, CLOSE_GOING_AWAY = 1001, CLOSE_POLICY = 1008, CLOSE_TRY_LATER = 1013 };

typedef struct stream {
    struct mg_connection *connection;
    int socket;
    view_client *client;
} stream;

// The socket of this process that is connected to the page; -1 if there is none.
static int socket_of(const struct mg_connection *connection)
{
    const struct mg_request_info *page = mg_get_request_info(connection);
    struct in_addr address;
    struct rlimit files;
    if (inet_pton(AF_INET, page->remote_addr, &address) != 1 || getrlimit(RLIMIT_NOFILE, &files))
        return -1;
    for (int fd = 0; fd < 65536 && (rlim_t)fd < files.rlim_cur; ++fd) {
        struct sockaddr_in peer = {0};
        socklen_t size = sizeof peer;
        if (!getpeername(fd, (struct sockaddr *)&peer, &size) && peer.sin_family == AF_INET &&
            peer.sin_addr.s_addr == address.s_addr && ntohs(peer.sin_port) == page->remote_port)
            return fd;
    }
    return -1;
}

// mg_websocket_write returns the bytes of the payload that it has sent, those of the header if
// there is no payload, or less than one. The lock keeps the other thread from writing after a part.
static bool send_frame(const stream *s, int opcode, const void *bytes, size_t size)
{
    enum { EMPTY_FRAME = 2 };
    mg_lock_connection(s->connection);
    const int sent = mg_websocket_write(s->connection, opcode, bytes, size);
    const bool whole = sent >= 0 && (size_t)sent == (size ? size : EMPTY_FRAME);
    if (!whole)
        shutdown(s->socket, SHUT_RDWR);
    mg_unlock_connection(s->connection);
    return whole;
}

static bool send_message(void *context, bool binary, const void *bytes, size_t size)
{
    return send_frame(context, binary ? MG_WEBSOCKET_OPCODE_BINARY : MG_WEBSOCKET_OPCODE_TEXT,
                      bytes, size);
}

static void send_close(const stream *s, int status)
{
    const unsigned char bytes[2] = {(unsigned char)(status >> 8), (unsigned char)status};
    send_frame(s, MG_WEBSOCKET_OPCODE_CONNECTION_CLOSE, bytes, sizeof bytes);
}

// ---- Reading ----

// Bytes read into the buffer; 0 if none arrived in a moment, -1 at the end of the connection.
static ssize_t receive(int fd, void *buffer, size_t size)
{
    struct pollfd one = {.fd = fd, .events = POLLIN};
    if (poll(&one, 1, 250) <= 0)
        return 0;
    const ssize_t count = recv(fd, buffer, size, MSG_DONTWAIT);
    return count > 0 ? count : count < 0 && (errno == EAGAIN || errno == EINTR) ? 0 : -1;
}

// 0, or the status to close with after these bytes. -1: close without one.
static int take_messages(const stream *s, frame_input *input)
{
    const unsigned char *payload;
    size_t size;
    for (;;)
        switch (frame_input_next(input, &payload, &size)) {
        case FRAME_NONE:
            return 0;
        case FRAME_TEXT:
            if (!view_hub_receive(s->client, (const char *)payload, size))
                return -1;
            break;
        case FRAME_PING:
            if (!send_frame(s, MG_WEBSOCKET_OPCODE_PONG, payload, size))
                return -1;
            break;
        case FRAME_PONG:
            break;
        case FRAME_CLOSE:
            return CLOSE_NORMAL;
        case FRAME_REFUSED:
            return input->close_status;
        }
}

// Until the page leaves, breaks the protocol, or is silent. Returns the status to close with; -1:
// close without one.
static int read_all(const stream *s, view_hub *hub, frame_input *input)
{
    double whole = clock_seconds(), heard = whole, pinged = whole; // times of the last of each
    double asked = whole; // time of the first ping since `heard`, if later than that
    for (int status = 0;;) {
        size_t room;
        unsigned char *space = frame_input_space(input, &room);
        const ssize_t count = receive(s->socket, space, room);
        const double now = clock_seconds();
        if (count < 0)
            return -1;
        if (count > 0) {
            frame_input_add(input, (size_t)count);
            status = take_messages(s, input);
            heard = now;
        }
        if (status)
            return status;
        if (view_hub_is_stopping(hub))
            return CLOSE_GOING_AWAY;
        if (!frame_input_is_partial(input))
            whole = now;
        if (now - whole > MESSAGE_SECONDS)
            return CLOSE_POLICY;
        if (asked > heard && now - asked > SILENT_SECONDS - PING_SECONDS)
            return -1;
        if (now - fmax(heard, pinged) > PING_SECONDS) {
            if (!send_frame(s, MG_WEBSOCKET_OPCODE_PING, NULL, 0)) // waits for a frame being sent
                return -1;
            pinged = clock_seconds();
            asked = asked > heard ? asked : pinged;
        }
    }
}

// Lets the page read what was sent: closing with unread bytes would discard it.
static void drain(int fd)
{
    char bytes[4096];
    const double end = clock_seconds() + DRAIN_SECONDS;
    shutdown(fd, SHUT_WR);
    while (clock_seconds() < end && receive(fd, bytes, sizeof bytes) >= 0)
        ;
}

// CivetWeb calls this after the handshake, in the thread of the connection. Reads until the end, so
// that CivetWeb, which has no limit for frames, reads nothing.
static void serve_stream(struct mg_connection *connection, void *hub)
{
    static const char full[] = "{\"type\":\"full\"}";
    stream s = {.connection = connection, .socket = socket_of(connection)};
    frame_input *input = calloc(1, sizeof *input);
    mg_disable_connection_keep_alive(connection); // ends it when this function returns
    if (input && s.socket >= 0) {
        hub_refusal why;
        s.client = view_hub_join(hub, send_message, &s, &why);
        int status = 0;
        if (s.client) {
            status = read_all(&s, hub, input);
            view_hub_leave(s.client);
        } else {
            if (why == HUB_FULL)
                send_frame(&s, MG_WEBSOCKET_OPCODE_TEXT, full, sizeof full - 1);
            status = why == HUB_STOPPING ? CLOSE_GOING_AWAY : CLOSE_TRY_LATER;
        }
        if (status > 0) {
            send_close(&s, status);
            drain(s.socket);
        }
    }
    free(input);
}

void view_stream_serve(struct mg_context *server, view_hub *hub)
{
    mg_set_websocket_handler(server, "/stream$", NULL, serve_stream, NULL, NULL, hub);
}
