/* SPDX-License-Identifier: MIT
 *
 * metrics_request.c - what a program asks for by HTTP/1 (RFC 9110 and 9112).
 *
 * One resource, /metrics, by GET or HEAD, one request a connection. A body is never read, so
 * nothing can hide a second request in one (the answer closes the connection).
 */
#include "serve/metrics_request.h"

#include "base/text/chars.h"

#include <string.h>
#include <strings.h>

#define OPENMETRICS "application/openmetrics-text"
#define QUALITY_MAX 1000u

/* A piece of the request. */
typedef struct piece {
    const char *text;
    size_t length;
} piece;

static bool is_text(piece p, const char *text)
{
    return p.length == strlen(text) && strncasecmp(p.text, text, p.length) == 0;
}

/* Cuts a piece at a character, takes the part before it out of `rest`, and trims that. */
static piece cut(piece *rest, char at)
{
    const char *end = memchr(rest->text, at, rest->length);
    piece part = {rest->text, end ? (size_t)(end - rest->text) : rest->length};
    const size_t used = part.length + (end != NULL);
    rest->text += used;
    rest->length -= used;
    while (part.length > 0 && strchr(" \t\r", part.text[part.length - 1]))
        part.length--;
    while (part.length > 0 && strchr(" \t", part.text[0])) {
        part.text++;
        part.length--;
    }
    return part;
}

/* Returns the bytes of an empty line at the begin of a piece; 0: there is none, or not yet. */
static size_t empty_line(piece rest)
{
    const size_t bytes = rest.length > 0 && rest.text[0] == '\r' ? 2 : 1;
    return rest.length >= bytes && rest.text[bytes - 1] == '\n' ? bytes : 0;
}

/* Returns what is known of a request, without an empty line before it (RFC 9112, 2.2). */
static piece begin_of(const char *text, size_t length)
{
    const piece all = {text, length < METRICS_REQUEST_MAX ? length : METRICS_REQUEST_MAX};
    const size_t empty = empty_line(all);
    return (piece){text + empty, all.length - empty};
}

/* Returns true when an empty line ends it. */
static bool has_end(piece rest)
{
    while (rest.length > 0 && empty_line(rest) == 0)
        (void)cut(&rest, '\n');
    return rest.length > 0;
}

bool metrics_request_is_whole(const char *text, size_t length)
{
    return length > METRICS_REQUEST_MAX || has_end(begin_of(text, length));
}

/* Returns what a program thinks of a kind of media: a weight (RFC 9110, 12.4.2), in thousandths. */
static unsigned quality_of(piece parameter)
{
    unsigned quality = 0, unit = QUALITY_MAX;
    for (size_t i = 2; i < parameter.length; i++) {
        const char c = parameter.text[i];
        if (c == '.')
            continue;
        if (c < '0' || c > '9')
            return 0;
        quality += (unsigned)(c - '0') * unit;
        unit /= 10;
    }
    return quality < QUALITY_MAX ? quality : QUALITY_MAX;
}

/* The word of a range of `Accept` about a kind: its exactness, and the weight. */
typedef struct opinion {
    unsigned exact;
    unsigned quality;
} opinion;

/* Returns true for a version of OpenMetrics that did not exist when this was written. */
static bool is_newer(piece parameter)
{
    return parameter.length > 8 && strncasecmp(parameter.text, "version=", 8) == 0 &&
           !memmem(parameter.text, parameter.length, "1.0.0", 5) &&
           !memmem(parameter.text, parameter.length, "0.0.1", 5);
}

/* Takes a range, whose first part is known, for a kind of media. */
static void weigh(opinion *o, piece range, const char *type, const char *group, piece rest)
{
    const unsigned exact = is_text(range, type)    ? 3
                           : is_text(range, group) ? 2
                           : is_text(range, "*/*") ? 1
                                                   : 0;
    unsigned quality = QUALITY_MAX;
    if (exact == 0 || exact < o->exact)
        return;
    while (rest.length > 0) {
        const piece parameter = cut(&rest, ';');
        if (parameter.length > 2 && strncasecmp(parameter.text, "q=", 2) == 0)
            quality = quality_of(parameter);
        else if (is_text(range, OPENMETRICS) && is_newer(parameter))
            return;
    }
    if (exact > o->exact || quality > o->quality)
        *o = (opinion){exact, quality};
}

/* The opinions of all lines of `Accept` about both kinds of text. */
typedef struct wish {
    opinion newer, older;
} wish;

/* Takes a line of `Accept`. */
static void read_accept(wish *w, piece accept)
{
    while (accept.length > 0) {
        piece rest = cut(&accept, ',');
        const piece range = cut(&rest, ';');
        weigh(&w->newer, range, OPENMETRICS, "application/*", rest);
        weigh(&w->older, range, "text/plain", "text/*", rest);
    }
}

/* Returns true for a kind that a program refuses, which is more than that it does not name it. */
static bool is_refused(const opinion *o)
{
    return o->exact > 0 && o->quality == 0;
}

/* Returns the path of a target, which may be an absolute one: http://HOST/PATH. */
static piece path_of(piece target)
{
    static const char scheme[] = "http://";
    const size_t bytes = sizeof scheme - 1;
    const piece path = cut(&target, '?');
    if (path.length <= bytes || strncasecmp(path.text, scheme, bytes) != 0)
        return path;
    const char *slash = memchr(path.text + bytes, '/', path.length - bytes);
    if (!slash || slash == path.text + bytes)
        return (piece){"", 0};
    return (piece){slash, path.length - (size_t)(slash - path.text)};
}

/* Reads the first line. Returns the status. */
static unsigned read_line(piece line, bool *head)
{
    const piece method = cut(&line, ' ');
    const piece target = cut(&line, ' ');
    const piece version = cut(&line, ' ');
    if (method.length == 0 || target.length == 0 || line.length > 0)
        return 400;
    if (version.length < 6 || strncmp(version.text, "HTTP/", 5) != 0)
        return 400;
    if (version.length != 8 || strncmp(version.text, "HTTP/1.", 7) != 0)
        return 505;
    *head = method.length == 4 && strncmp(method.text, "HEAD", 4) == 0;
    if (!*head && !(method.length == 3 && strncmp(method.text, "GET", 3) == 0))
        return 405;
    const piece path = path_of(target);
    return path.length == 8 && strncmp(path.text, "/metrics", 8) == 0 ? 200 : 404;
}

metrics_request metrics_request_read(const char *text, size_t length)
{
    metrics_request request = {.status = 431, .openmetrics = true};
    piece rest = begin_of(text, length);
    wish wished = {.newer.exact = 0};
    if (!has_end(rest))
        return request;
    const bool plain = !memchr(rest.text, 0, rest.length);
    request.status = plain ? read_line(cut(&rest, '\n'), &request.head) : 400;
    while (rest.length > 0 && empty_line(rest) == 0) {
        piece line = cut(&rest, '\n');
        const piece name = cut(&line, ':');
        if (is_text(name, "accept"))
            read_accept(&wished, line);
    }
    request.openmetrics =
        !is_refused(&wished.newer) && wished.newer.quality >= wished.older.quality;
    if (request.status == 200 && is_refused(&wished.newer) && is_refused(&wished.older))
        request.status = 406;
    return request;
}

/* The answers without a page. */
static const struct {
    unsigned status;
    const char *reason;
    const char *text;
} errors[] = {
    {400, "Bad Request", "this is no request of HTTP/1\n"},
    {404, "Not Found", "there is only /metrics\n"},
    {405, "Method Not Allowed", "only GET and HEAD: nothing can be changed here\n"},
    {406, "Not Acceptable", "only application/openmetrics-text and text/plain\n"},
    {431, "Request Header Fields Too Large", "the request is too long\n"},
    {505, "HTTP Version Not Supported", "only HTTP/1.0 and HTTP/1.1\n"},
    {503, "Service Unavailable", "out of memory\n"},
};

size_t metrics_request_answer(char out[METRICS_HEAD_BYTES], const metrics_request *request,
                              size_t bytes)
{
    static const char common[] = "Cache-Control: no-store\r\nConnection: close\r\n\r\n";
    size_t i = 0;
    if (request->status == 200)
        return chars_print(out, METRICS_HEAD_BYTES, 0,
                           "HTTP/1.1 200 OK\r\nContent-Type: %s; charset=utf-8\r\n"
                           "Content-Length: %zu\r\n%s",
                           request->openmetrics ? OPENMETRICS "; version=1.0.0"
                                                : "text/plain; version=0.0.4", bytes, common);
    while (errors[i].status != request->status)
        i++;
    return chars_print(out, METRICS_HEAD_BYTES, 0,
                       "HTTP/1.1 %u %s\r\nContent-Type: text/plain; charset=utf-8\r\n%s"
                       "Content-Length: %zu\r\n%s%s", errors[i].status, errors[i].reason,
                       request->status == 405 ? "Allow: GET, HEAD\r\n" : "",
                       strlen(errors[i].text), common, request->head ? "" : errors[i].text);
}
