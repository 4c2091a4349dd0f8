// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// One of CivetWeb's threads reads from each connection, the hub's own threads send. CivetWeb gives
// up sending after its time limit, in the middle of a message, and does not report its socket. The
// socket is therefore found by the address of the page, and shut down: nothing else can follow half
// a message, and the thread that reads ends.

#include "viewer/view_stream.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>

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

static void stream_ready(struct mg_connection *connection, void *hub)
{
    static const char full[] = "{\"type\":\"full\"}";
    static const unsigned char try_later[2] = {1013 >> 8, 1013 & 255}; // RFC 6455 registry
    stream *s = calloc(1, sizeof *s);
    if (!s)
        return;
    *s = (stream){.connection = connection, .socket = socket_of(connection)};
    mg_set_user_connection_data(connection, s);
    s->client = s->socket >= 0 ? view_hub_join(hub, send_message, s) : NULL;
    if (s->client || s->socket < 0)
        return;
    send_frame(s, MG_WEBSOCKET_OPCODE_TEXT, full, sizeof full - 1);
    send_frame(s, MG_WEBSOCKET_OPCODE_CONNECTION_CLOSE, try_later, sizeof try_later);
}

static int stream_data(struct mg_connection *connection, int bits, char *data, size_t size,
                       void *hub)
{
    enum { FINAL = 0x80, RESERVED = 0x70, OPCODE = 0x0f };
    (void)hub;
    const stream *s = mg_get_user_connection_data(connection);
    const int opcode = bits & OPCODE;
    if (!s || !s->client || bits & RESERVED)
        return 0;
    if (opcode == MG_WEBSOCKET_OPCODE_PONG || opcode == MG_WEBSOCKET_OPCODE_PING)
        return 1;
    // Pages send short texts, which browsers do not fragment.
    if (opcode != MG_WEBSOCKET_OPCODE_TEXT || !(bits & FINAL) || size > MESSAGE_BYTES)
        return 0;
    return view_hub_receive(s->client, data, size);
}

static void stream_close(const struct mg_connection *connection, void *hub)
{
    (void)hub;
    stream *s = mg_get_user_connection_data(connection);
    mg_set_user_connection_data(connection, NULL);
    if (s && s->client)
        view_hub_leave(s->client);
    free(s);
}

void view_stream_serve(struct mg_context *server, view_hub *hub)
{
    mg_set_websocket_handler(server, "/stream$", NULL, stream_ready, stream_data, stream_close,
                             hub);
}
