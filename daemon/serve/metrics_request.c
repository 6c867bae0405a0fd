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

bool metrics_request_is_whole(const char *text, size_t length)
{
    const size_t known = length < METRICS_REQUEST_MAX ? length : METRICS_REQUEST_MAX;
    return length > METRICS_REQUEST_MAX || memmem(text, known, "\r\n\r\n", 4) ||
           memmem(text, known, "\n\n", 2);
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

/* Returns true unless the program prefers the older text, as far as `Accept` says so. */
static bool takes_openmetrics(piece accept)
{
    opinion newer = {0, 0}, older = {0, 0};
    while (accept.length > 0) {
        piece rest = cut(&accept, ',');
        const piece range = cut(&rest, ';');
        weigh(&newer, range, OPENMETRICS, "application/*", rest);
        weigh(&older, range, "text/plain", "text/*", rest);
    }
    return newer.quality >= older.quality;
}

/* Reads the first line. Returns the status. */
static unsigned read_line(piece line, bool *head)
{
    const piece method = cut(&line, ' ');
    piece target = cut(&line, ' ');
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
    const piece path = cut(&target, '?');
    return path.length == 8 && strncmp(path.text, "/metrics", 8) == 0 ? 200 : 404;
}

metrics_request metrics_request_read(const char *text, size_t length)
{
    metrics_request request = {.status = 431, .openmetrics = true};
    piece rest = {text, length < METRICS_REQUEST_MAX ? length : METRICS_REQUEST_MAX};
    piece accept = {"", 0};
    if (!metrics_request_is_whole(text, rest.length))
        return request;
    const bool plain = !memchr(text, 0, rest.length);
    request.status = plain ? read_line(cut(&rest, '\n'), &request.head) : 400;
    while (rest.length > 0) {
        piece line = cut(&rest, '\n');
        if (line.length == 0)
            break;
        const piece name = cut(&line, ':');
        if (is_text(name, "accept"))
            accept = cut(&line, '\n');
    }
    request.openmetrics = takes_openmetrics(accept);
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
