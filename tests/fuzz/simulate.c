/* SPDX-License-Identifier: MIT
 *
 * simulate.c - the bus of a configuration in virtual time.
 */
#include "simulate.h"

#include "fuzz.h"

#include "record/output.h"
#include "run/release.h"

#include <string.h>

#define BITS 20000u
#define RELEASES_MAX 20000u
#define MEMORY_MAX (64u << 20) /* of a bus; what is larger is not simulated */
#define WORK 160000u           /* nodes times bits */

static void tell(void *user, bool failed, const char *text)
{
    (void)user;
    (void)failed;
    REQUIRE(text[0] != '\0' && strchr(text, '\n') == NULL);
}

/* Hands in what is due before the end, as `canwire sim` does; returns where it has come to. */
static void run_releases(fuzz_bus *b, const cfg *config, uint64_t end)
{
    release_plan *plan = release_plan_new(config, tell, NULL);
    REQUIRE(plan != NULL);
    release_look(plan, b->bus);
    for (unsigned i = 0; i < RELEASES_MAX && release_next_tick(plan) <= end; i++) {
        if (release_hand_in(plan, b->bus) == CW_FULL)
            fuzz_bus_advance(b, cw_bus_inbox_first(b->bus) + b->bit_ticks);
        release_look(plan, b->bus);
    }
    release_plan_free(plan);
}

static void print_results(const fuzz_bus *b, const cfg *config)
{
    FILE *out = fopen("/dev/null", "we");
    REQUIRE(out != NULL);
    output_stats(out, config, b->bus);
    (void)fclose(out);
}

void fuzz_simulate(const cfg *config)
{
    fuzz_bus b;
    cw_node_config nodes[CW_NODES_MAX];
    cw_bus_config bus_config;
    cfg_bus_config(&bus_config, nodes, config);
    size_t size = cw_bus_size(&bus_config);
    REQUIRE(size > 0);
    if (size > MEMORY_MAX)
        return;
    REQUIRE(fuzz_bus_open(&b, &bus_config));
    release_add_replies(b.bus, config);
    unsigned bits = (unsigned)(WORK / config->node_count);
    uint64_t end = cw_rate_ticks(config->rate, bits < BITS ? bits : BITS);
    run_releases(&b, config, end);
    fuzz_bus_advance(&b, end);
    fuzz_bus_check(&b);
    print_results(&b, config);
    fuzz_bus_close(&b);
}
