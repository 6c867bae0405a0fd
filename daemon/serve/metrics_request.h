/* SPDX-License-Identifier: MIT
 *
 * metrics_request.h - what a program asks for by HTTP/1, as far as a page of metrics needs it.
 */
#ifndef CANWIRE_SERVE_METRICS_REQUEST_H
#define CANWIRE_SERVE_METRICS_REQUEST_H

#include <stdbool.h>
#include <stddef.h>

#define METRICS_REQUEST_MAX 8192u /* bytes of a request, up to its empty line */
#define METRICS_HEAD_BYTES 512u   /* of the head of an answer, or of an answer without a page */

typedef struct metrics_request {
    unsigned status;  /* of the answer: 200 or an error */
    bool head;        /* only the head is wanted */
    bool openmetrics; /* the program takes OpenMetrics; or only the older text */
} metrics_request;

/* Returns true when a request ends within these bytes, or is longer than METRICS_REQUEST_MAX; what
 * follows does not count. */
bool metrics_request_is_whole(const char *text, size_t length);

/* Reads such a request. */
metrics_request metrics_request_read(const char *text, size_t length);

/* Prints the head of an answer with a page of that many bytes, or the whole answer for another
 * status. Returns its length. */
size_t metrics_request_answer(char out[METRICS_HEAD_BYTES], const metrics_request *request,
                              size_t bytes);

#endif
