// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// CivetWeb calls answer_request first for every request, and the functions of view_stream.c only if
// it returns 0, which it does for /stream. CivetWeb has no document root, so it never opens a file.
// One of its threads belongs to each connection; the hub's own threads send, so that a page that
// does not read blocks only its own thread, until CivetWeb's time limit. CivetWeb's threads have
// stacks of 100 KB, which include all thread-local variables of the program.

#include "viewer/view_server.h"

#include <arpa/inet.h>
#include <civetweb.h>
#include <errno.h>
#include <netinet/in.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "cli/output.h"
#include "cli/progress.h"
#include "viewer/photo_queue.h"
#include "viewer/view_stream.h"

extern const char viewer_page[]; // generated from viewer_page.html, .css and .js

enum { NONCE_LENGTH = TOKEN_LENGTH };
// A connection takes a thread before its request is known, for at most the time limit. The limit
// is also that of a write without progress.
#define CONNECTIONS "128"
#define TIME_LIMIT_MS "5000"

struct view_server {
    view_server_options options;
    access_rules rules;
    struct mg_context *context;
    photo_queue photos;
    char *url;
};

// ---- Addresses ----

bool view_address_host(const char *text, view_address *address)
{
    struct in_addr binary;
    if (!strcmp(text, "localhost"))
        text = "127.0.0.1";
    if (inet_pton(AF_INET, text, &binary) != 1)
        return false;
    snprintf(address->host, sizeof address->host, "%s", text);
    return true;
}

bool view_address_parse(const char *text, view_address *address)
{
    const char *colon = strrchr(text, ':'), *port = colon ? colon + 1 : text;
    char host[64] = "127.0.0.1";
    if (colon) {
        if ((size_t)(colon - text) >= sizeof host)
            return false;
        memcpy(host, text, (size_t)(colon - text));
        host[colon - text] = 0;
    }
    const size_t digits = strspn(port, "0123456789");
    if (digits < 1 || digits > 5 || port[digits] || atoi(port) > 65535)
        return false;
    address->port = atoi(port);
    return view_address_host(host, address);
}

bool view_address_is_loopback(const view_address *address)
{
    return !strncmp(address->host, "127.", 4);
}

// CivetWeb does not report why it fails.
bool view_address_is_free(const view_address *address)
{
    struct sockaddr_in at = {.sin_family = AF_INET, .sin_port = htons((uint16_t)address->port)};
    inet_pton(AF_INET, address->host, &at.sin_addr);
    const int one = 1, fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    int problem = fd < 0 ? errno : 0;
    if (fd >= 0) {
        setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &one, sizeof one);
        if (bind(fd, (const struct sockaddr *)&at, sizeof at) || listen(fd, 1))
            problem = errno;
        close(fd);
    }
    if (problem == EADDRINUSE)
        fail_run("port %d of %s is in use; choose another port, or 0 for any free one",
                 address->port, address->host);
    else if (problem == EADDRNOTAVAIL)
        fail_run("%s is not an address of this machine; use 127.0.0.1, or 0.0.0.0 for all "
                 "addresses",
                 address->host);
    else if (problem)
        fail_run("port %d of %s cannot be opened: %s", address->port, address->host,
                 strerror(problem));
    return !problem;
}

// ---- HTTP ----

static const char common_headers[] = "X-Content-Type-Options: nosniff\r\n"
                                     "Referrer-Policy: no-referrer\r\n"
                                     "Cross-Origin-Resource-Policy: same-origin\r\n"
                                     "Cross-Origin-Opener-Policy: same-origin\r\n"
                                     "X-Frame-Options: DENY\r\n"
                                     "Cache-Control: no-store\r\n"
                                     "Connection: close\r\n";

static int send_status(struct mg_connection *connection, int status, const char *text)
{
    mg_printf(connection,
              "HTTP/1.1 %d %s\r\n%sContent-Security-Policy: default-src 'none'\r\n"
              "Content-Type: text/plain; charset=utf-8\r\nContent-Length: %zu\r\n\r\n%s\n",
              status, mg_get_response_code_text(connection, status), common_headers,
              strlen(text) + 1, text);
    return status;
}

// The page, whose placeholders NONCE allow exactly its own script and style.
static int send_page(const view_server *server, struct mg_connection *connection,
                     const access_request *request)
{
    static const char placeholder[] = "NONCE";
    char nonce[NONCE_LENGTH + 1], cookie[300] = "", outer[4 * HOST_MAXIMUM] = "";
    if (!token_create(nonce))
        return send_status(connection, 503, "the system provides no random numbers");
    if (server->rules.token && *request->token) {
        char name[COOKIE_MAXIMUM + 1];
        token_cookie_name(&server->rules, name);
        // Without Path, for the path of the page, which a proxy may serve below others.
        snprintf(cookie, sizeof cookie, "Set-Cookie: %s=%s; HttpOnly; SameSite=Strict\r\n", name,
                 server->rules.token);
    }
    if (server->rules.token && *request->forwarded)
        snprintf(outer, sizeof outer, " ws://%s wss://%s", request->forwarded, request->forwarded);
    size_t placeholders = 0;
    for (const char *at = viewer_page; (at = strstr(at, placeholder)); at += strlen(placeholder))
        ++placeholders;
    mg_printf(connection,
              "HTTP/1.1 200 OK\r\n%s%s"
              "Content-Security-Policy: default-src 'none'; script-src 'nonce-%s'; style-src "
              "'nonce-%s'; img-src 'self' blob: data:; connect-src 'self' ws://%s wss://%s%s; "
              "base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n"
              "Content-Type: text/html; charset=utf-8\r\nContent-Length: %zu\r\n\r\n",
              common_headers, cookie, nonce, nonce, request->host, request->host, outer,
              strlen(viewer_page) + placeholders * (NONCE_LENGTH - strlen(placeholder)));
    const char *at = viewer_page;
    for (const char *next; (next = strstr(at, placeholder)); at = next + strlen(placeholder)) {
        mg_write(connection, at, (size_t)(next - at));
        mg_write(connection, nonce, NONCE_LENGTH);
    }
    mg_write(connection, at, strlen(at));
    return 200;
}

// Number N of "/photo/N"; -1 if the path is different.
static long index_of(const char *path, const char *prefix)
{
    const size_t length = strlen(prefix);
    if (strncmp(path, prefix, length) != 0)
        return -1;
    const size_t digits = strspn(path + length, "0123456789");
    return digits >= 1 && digits <= 7 && !path[length + digits] ? strtol(path + length, NULL, 10)
                                                                : -1;
}

// Answers with the reason if the photo exceeds the memory for it.
static bool is_too_large(const view_server *server, struct mg_connection *connection, size_t index,
                         photo_use use)
{
    char text[200];
    const view_source *source = server->options.source;
    const size_t bytes = photo_picture_bytes(source->scene, index, use);
    if (!source->photo_bytes || bytes <= source->photo_bytes)
        return false;
    snprintf(text, sizeof text,
             "the photo is not shown: it takes about %.0f MB, more than the %.0f MB that "
             "--max-memory of the training leaves for it",
             (double)bytes / 1e6, (double)source->photo_bytes / 1e6);
    send_status(connection, 507, text);
    return true;
}

static int send_photo(view_server *server, struct mg_connection *connection, long index,
                      photo_use use)
{
    const sgs_scene *scene = server->options.source->scene;
    encoded_picture picture = {0};
    if (!scene || index < 0 || (size_t)index >= scene->view_count)
        return send_status(connection, 404, "no such photo");
    if (is_too_large(server, connection, (size_t)index, use))
        return 507;
    switch (photo_queue_get(&server->photos, (size_t)index, use, &picture)) {
    case PHOTO_STOPPED:
        return send_status(connection, 503, "sparegs is shutting down");
    case PHOTO_UNREADABLE:
        return send_status(connection, 404, "the photo cannot be read");
    case PHOTO_MADE:
        break;
    }
    mg_printf(connection, "HTTP/1.1 200 OK\r\n%sContent-Type: %s\r\nContent-Length: %zu\r\n\r\n",
              common_headers, photo_media_type(use), picture.size);
    mg_write(connection, picture.bytes, picture.size);
    encoded_picture_free(&picture);
    return 200;
}

static int route(view_server *server, struct mg_connection *connection,
                 const struct mg_request_info *info, const access_request *request)
{
    const char *path = info->local_uri ? info->local_uri : "";
    if (!strcmp(path, "/stream"))
        return request->host && mg_get_header(connection, "Upgrade")
                   ? 0
                   : send_status(connection, 426,
                                 "this address accepts only WebSocket connections");
    if (!strcmp(path, "/"))
        return send_page(server, connection, request);
    if (!strcmp(path, "/favicon.ico")) {
        mg_printf(connection, "HTTP/1.1 204 No Content\r\n%s\r\n", common_headers);
        return 204;
    }
    const long photo = index_of(path, "/photo/"), thumb = index_of(path, "/thumb/");
    if (photo >= 0 || thumb >= 0)
        return send_photo(server, connection, photo >= 0 ? photo : thumb,
                          photo >= 0 ? PHOTO_WHOLE : PHOTO_THUMBNAIL);
    return send_status(connection, 404, "not found");
}

static int answer_request(struct mg_connection *connection)
{
    const struct mg_request_info *info = mg_get_request_info(connection);
    view_server *server = info->user_data;
    char token[TOKEN_MAXIMUM + 1] = "", forwarded[HOST_MAXIMUM + 1];
    if (info->query_string)
        mg_get_var(info->query_string, strlen(info->query_string), "token", token, sizeof token);
    forwarded_host(mg_get_header(connection, "X-Forwarded-Host"), forwarded);
    const access_request request = {.host = mg_get_header(connection, "Host"),
                                    .origin = mg_get_header(connection, "Origin"),
                                    .cookie = mg_get_header(connection, "Cookie"),
                                    .token = token,
                                    .forwarded = forwarded};
    if (strcmp(info->request_method, "GET") != 0)
        return send_status(connection, 405, "only GET is supported");
    const int access = access_check(&server->rules, &request);
    if (access == 401)
        return send_status(connection, 401,
                           "a token is required: open the address that sparegs printed");
    if (access != 200)
        return send_status(connection, access,
                           "host or origin not allowed; behind a reverse proxy, set a token "
                           "(--token, or --view-token of train) and forward the browser's Host, or "
                           "send it as X-Forwarded-Host");
    return route(server, connection, info, &request);
}

// ---- Start and stop ----

static int drop_message(const struct mg_connection *connection, const char *message)
{
    (void)connection;
    (void)message;
    return 1;
}

static char *url_of(const view_server *server)
{
    char host[256];
    const char *name = server->options.address.host;
    if (!strcmp(name, "0.0.0.0") && !gethostname(host, sizeof host))
        name = host;
    return server->rules.token ? format_text("http://%s:%d/?token=%s", name, server->rules.port,
                                             server->rules.token)
                               : format_text("http://%s:%d/", name, server->rules.port);
}

view_server *view_server_start(const view_server_options *options)
{
    if (!view_address_is_free(&options->address))
        return NULL;
    view_server *server = calloc(1, sizeof *server);
    char listening[96];
    snprintf(listening, sizeof listening, "%s:%d", options->address.host, options->address.port);
    const char *settings[] = {"listening_ports",
                              listening,
                              "num_threads",
                              CONNECTIONS,
                              "request_timeout_ms",
                              TIME_LIMIT_MS,
                              "enable_directory_listing",
                              "no",
                              "access_control_allow_origin",
                              "",
                              "tcp_nodelay",
                              "1",
                              NULL};
    const struct mg_callbacks callbacks = {
        .begin_request = answer_request, .log_message = drop_message, .log_access = drop_message};
    if (server) {
        server->options = *options;
        photo_queue_open(&server->photos, options->hub, options->source, options->share);
        server->rules = (access_rules){.loopback = view_address_is_loopback(&options->address),
                                       .token = options->token,
                                       .port = options->address.port};
        server->context = mg_start(&callbacks, server, settings);
    }
    struct mg_server_port port;
    if (!server || !server->context || mg_get_server_ports(server->context, 1, &port) != 1) {
        fail_run("%s: the server cannot be started; choose another port", listening);
        view_server_stop(server);
        return NULL;
    }
    server->rules.port = port.port;
    server->url = url_of(server);
    view_stream_serve(server->context, options->hub);
    return server;
}

const char *view_server_url(const view_server *server)
{
    return server->url;
}

typedef struct stop_call {
    const view_address *address;
    int port;
    atomic_bool returned;
} stop_call;

// Connects to the server until mg_stop has returned. CivetWeb's thread that waits for connections
// looks at the request to stop after each connection, otherwise every 2 s.
static void *wake_listener(void *context)
{
    stop_call *const call = context;
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons((uint16_t)call->port)};
    inet_pton(AF_INET, call->address->host, &to.sin_addr);
    while (!atomic_load(&call->returned)) {
        const int connection = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
        if (connection >= 0) {
            (void)!connect(connection, (const struct sockaddr *)&to, sizeof to);
            close(connection);
        }
        nanosleep(&(struct timespec){.tv_nsec = 10000000}, NULL);
    }
    return NULL;
}

static void stop_context(const view_server *server)
{
    stop_call call = {.address = &server->options.address, .port = server->rules.port};
    pthread_t waker;
    const bool woken = !pthread_create(&waker, NULL, wake_listener, &call);
    mg_stop(server->context);
    atomic_store(&call.returned, true);
    if (woken)
        pthread_join(waker, NULL);
}

void view_server_stop(view_server *server)
{
    if (server && server->context)
        stop_context(server);
    if (server) {
        photo_queue_close(&server->photos);
        free(server->url);
    }
    free(server);
}
