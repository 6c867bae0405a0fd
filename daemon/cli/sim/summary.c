/* SPDX-License-Identifier: MIT
 *
 * summary.c - a bus and its nodes as a small table for people.
 */
#include "cli/sim/summary.h"

#include "base/text/counted.h"
#include "record/output.h"
#include "record/rate_load.h"
#include "record/residual.h"

#include <inttypes.h>

static uint64_t summary_sum(const uint64_t *counters, unsigned count)
{
    uint64_t total = 0;
    for (unsigned i = 0; i < count; i++)
        total += counters[i];
    return total;
}

/* Errors and drops are sums over their types, which would not fit into a line. */
static void print_node(FILE *out, const cfg_node *node, const cw_node_stats *s)
{
    fprintf(out,
            "%-16s %-13s %4u %4u %9" PRIu64 " %9" PRIu64 " %8" PRIu64 " %8" PRIu64 " %8" PRIu64
            " %7" PRIu32 "\n",
            node->name, cw_state_name(s->state), s->tec, s->rec, s->tx_frames, s->rx_frames,
            s->arbitration_lost, summary_sum(s->errors, CW_ERROR_COUNT),
            summary_sum(s->dropped, CW_DROP_COUNT), s->queue);
}

static void print_load(FILE *out, const char *rate, rate_load load)
{
    fprintf(out, "; %" PRIu64 " %s bits, load %u.%u %%", load.bits, rate, load.permille / 10,
            load.permille % 10);
}

/* Prints what CAN FD adds. */
static void print_fd(FILE *out, const cw_bus_stats *stats)
{
    const cw_bus_stats start = {.bits = 0};

    fprintf(out, "CAN FD: %s", counted(stats->fd_frames, "frame").text);
    print_load(out, "nominal", rate_load_nominal(&start, stats));
    print_load(out, "data", rate_load_data(&start, stats));
    fputc('\n', out);
}

/* Prints the share of bad frames, and how many that nobody has noticed are to be expected. */
static void print_errors(FILE *out, const cw_bus_stats *stats)
{
    const uint64_t ppm = residual_error_ppm(stats), ppt = residual_expected_ppt(stats);
    fprintf(out, "errors: %" PRIu64 ".%04" PRIu64 " %% of all frames; undetected ones: %" PRIu64
            " counted, %.2g expected\n", ppm / 10000, ppm % 10000, stats->undetected_errors,
            (double)ppt * 1e-12);
}

/* Returns true for a node that needs a line with its types of errors. */
static bool has_errors(const cw_node_stats *node)
{
    bool any = false;

    for (unsigned type = 0; type < CW_ERROR_COUNT; type++)
        any = any || node->errors[type];
    return any;
}

/* Prints the errors of each node that has found some, by their type. */
static void print_error_types(FILE *out, const cfg *config, const cw_bus *bus)
{
    bool titled = false;

    for (unsigned i = 0; i < config->node_count; i++) {
        cw_node_stats node;

        if (cw_node_get_stats(bus, i, &node) != CW_OK || !has_errors(&node))
            continue;
        if (!titled)
            fprintf(out, "%-16s", "errors");
        for (unsigned type = 0; !titled && type < CW_ERROR_COUNT; type++)
            fprintf(out, " %9s", cw_error_type_name((cw_error_type)type));
        fprintf(out, "%s%-16s", titled ? "" : "\n", config->nodes[i].name);
        for (unsigned type = 0; type < CW_ERROR_COUNT; type++)
            fprintf(out, " %9" PRIu64, node.errors[type]);
        fputc('\n', out);
        titled = true;
    }
}

void summary_print(FILE *out, const cfg *config, const cw_bus *bus)
{
    cw_bus_stats stats;
    cw_bus_get_stats(bus, &stats);
    char time[TIME_TEXT_MAX];
    text_print_seconds(time, stats.ticks);
    const cw_bus_stats start = {.bits = 0};
    unsigned load = cw_load_permille(&start, &stats);
    fprintf(out,
            "%s: %s s at %u bit/s, %s, load %u.%u %%, %s, %s\n", config->bus_name, time,
            config->bitrate_bps, counted(stats.frames, "frame").text, load / 10, load % 10,
            counted(stats.error_frames, "error frame").text,
            counted(stats.faults, "fault hit").text);
    if (stats.error_frames)
        print_errors(out, &stats);
    if (output_has_fd(config, bus))
        print_fd(out, &stats);
    fprintf(out, "%-16s %-13s %4s %4s %9s %9s %8s %8s %8s %7s\n", "node", "state", "tec", "rec",
            "tx", "rx", "arb-lost", "errors", "dropped", "queued");
    for (unsigned i = 0; i < config->node_count; i++) {
        cw_node_stats node;
        if (cw_node_get_stats(bus, i, &node) == CW_OK)
            print_node(out, &config->nodes[i], &node);
    }
    print_error_types(out, config, bus);
}
