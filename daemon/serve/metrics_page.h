/* SPDX-License-Identifier: MIT
 *
 * metrics_page.h - the counters of all buses as text for Prometheus: OpenMetrics 1.0, or the older
 *                  text format.
 *
 * Families and their samples come from the tables of canwire_counters.h and port.h, and from
 * smaller ones of metrics_page.c. A page copies what it needs first, so that all numbers are of one
 * moment. It is then written in parts, each of which takes little time.
 */
#ifndef CANWIRE_SERVE_METRICS_PAGE_H
#define CANWIRE_SERVE_METRICS_PAGE_H

#include "base/file/sink.h"
#include "base/text/buffer.h"
#include "config/config.h"
#include "engine/report.h"
#include "serve/status.h"
#include "serve/verdicts.h"

typedef struct metrics_page {
    buffer text;      /* as far as it has been written */
    bool openmetrics; /* or the older format */
    buffer things;    /* buses, nodes and all else that has counters */
    buffer labels;    /* their labels */
    buffer stats;     /* copies of their counters */
    unsigned set;     /* the next family: its table ... */
    unsigned row;     /* ... and its row */
} metrics_page;

/* Requests of programs for such pages. */
typedef struct metrics_own {
    uint64_t requests; /* answered with a page */
    uint64_t refused;  /* answered with an error */
    uint64_t dropped;  /* without a whole answer: too slow, or gone */
    uint64_t clients;  /* connected now */
} metrics_own;

/* Begins a page; all zeros is one that has been freed. */
void metrics_page_begin(metrics_page *page, bool openmetrics);

/* Adds a bus with its nodes and rules, and the errors that its nodes have detected. */
void metrics_page_bus(metrics_page *page, const cfg *config, const cw_bus *bus,
                      const report *beyond, const status_errors *errors);

/* Adds the sinks of a bus; NULL: of all buses together. */
void metrics_page_sinks(metrics_page *page, const char *bus, const sink_list *all);

/* Adds how many expectations a bus has, if there are any, and how many have failed. */
void metrics_page_verdicts(metrics_page *page, const char *bus, const verdicts *all);

/* Adds the result of gateways_stats(). */
void metrics_page_gateways(metrics_page *page, const json_t *gateways);

/* Adds the requests themselves. */
void metrics_page_own(metrics_page *page, const metrics_own *own);

/* Writes the next family. Returns false when the page is complete. */
bool metrics_page_write(metrics_page *page);

/* Returns false when there was no memory for all of it. */
bool metrics_page_is_good(const metrics_page *page);

/* Frees all but the text, and gives that to the caller. */
buffer metrics_page_take(metrics_page *page);

void metrics_page_free(metrics_page *page);

#endif
