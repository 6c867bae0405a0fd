/* SPDX-License-Identifier: MIT
 *
 * fuzz_reload.c - a running bus that changes from one configuration to the next, with frames,
 * rules, settings and vanishing interfaces in between.
 *
 * Input: operations behind lines "=== HEAD". A name that contains a point begins a file, which
 * replaces one of that name. "reload" changes the bus to the present bus.yaml (the first time it
 * starts with it). "inject" adds rules. Other heads are operations, and their text is numbers. Two
 * buses do the same, one bit by bit: their events must be the same.
 */
#include "fuzz.h"

#include "config/config.h"
#include "parts.h"
#include "record/output.h"
#include "run/bus_make.h"
#include "run/inputs.h"
#include "run/live.h"
#include "run/release.h"

#include <stdlib.h>
#include <string.h>

#define BITS_MAX 6000u
#define WORK 100000u /* nodes times bits */
#define RELEASES_MAX 2000u
#define OPERATIONS_MAX 64u

typedef struct world {
    bool stepping;
    live *live;
    void *memory;
    release_plan *plan;
    inputs inputs;
    uint64_t bits_left;
    char *text; /* events */
    size_t size;
    FILE *out;
} world;

/* ---- The bus --------------------------------------------------------------------------------- */

static void tell(void *user, bool failed, const char *text)
{
    (void)user;
    (void)failed;
    (void)text;
}

static void drain(void *user)
{
    world *w = user;
    cw_event event;
    const cfg *config = live_config(w->live);
    while (cw_bus_poll(w->inputs.bus, &event)) {
        REQUIRE(config->node_count == CW_NODES_MAX || event.nodes >> config->node_count == 0);
        output_event(w->out, config, &event);
    }
}

static void run(world *w, uint64_t bits)
{
    const cfg *config = live_config(w->live);
    if (bits > w->bits_left)
        bits = w->bits_left;
    if (bits * config->node_count > WORK)
        bits = WORK / config->node_count;
    w->bits_left -= bits;
    uint64_t end = cw_bus_now(w->inputs.bus) + cw_rate_ticks(config->rate, bits);
    for (unsigned i = 0; i < RELEASES_MAX && release_next_tick(w->plan) <= end; i++)
        if (inputs_release(&w->inputs, w->plan) == CW_FULL)
            inputs_advance(&w->inputs,
                           cw_bus_inbox_first(w->inputs.bus) + cw_rate_ticks(config->rate, 1));
    inputs_advance(&w->inputs, end);
}

static void check_books(const world *w)
{
    for (unsigned i = 0; i < live_config(w->live)->node_count; i++) {
        cw_node_stats stats;
        REQUIRE(cw_node_get_stats(w->inputs.bus, i, &stats) == CW_OK);
        REQUIRE(cw_node_stats_balance(&stats));
    }
}

/* ---- Configurations -------------------------------------------------------------------------- */

static void start(world *w, cfg *config)
{
    w->live = live_new(config);
    cw_bus *bus = bus_make(&w->memory, config);
    w->plan = release_plan_new(config, tell, NULL);
    REQUIRE(w->live && bus && w->plan);
    cw_bus_set_stepping(bus, w->stepping);
    inputs_init(&w->inputs, w->live, bus, drain, w);
}

/* Changes the configuration; settings that cannot change are refused elsewhere. */
static void go_over(world *w, cfg *config)
{
    uint8_t from[CW_NODES_MAX];
    void *memory;
    cw_bus *bus = bus_make(&memory, config);
    release_plan *plan = release_plan_new(config, tell, NULL);
    REQUIRE(bus && plan);
    cfg_match_nodes(from, config, live_config(w->live));
    const uint64_t now = cw_bus_now(w->inputs.bus);
    REQUIRE(inputs_take_over(&w->inputs, bus, config, from, now) == CW_OK);
    release_take_over(plan, w->plan, from, now);
    release_plan_free(w->plan);
    free(w->memory);
    w->plan = plan;
    w->memory = memory;
    live_replace(w->live, config);
}

static void reload(world *w, const cfg_file *files, size_t count)
{
    char *messages = NULL;
    size_t length = 0;
    FILE *errors = open_memstream(&messages, &length);
    cfg *config = count > 0 ? cfg_load_given(files, count, errors) : NULL;
    (void)fclose(errors);
    free(messages);
    if (config && !w->live)
        start(w, config);
    else if (config && config->rate.bit_ticks == live_config(w->live)->rate.bit_ticks)
        go_over(w, config);
    else
        cfg_free(config);
}

/* ---- Operations ------------------------------------------------------------------------------ */

static void inject(world *w, const fuzz_part *part)
{
    char *messages = NULL;
    size_t length = 0;
    FILE *errors = open_memstream(&messages, &length);
    cfg_rules *rules = inputs_inject(&w->inputs, part->text, part->size, "inject", errors);
    (void)fclose(errors);
    REQUIRE((rules != NULL) == (length == 0));
    cfg_free_rules(rules);
    free(messages);
}

static void set(world *w, unsigned node, fuzz_input *in)
{
    const cw_settings settings = {.which = fuzz_u8(in) & 0x1Fu,
                                  .modes_mask = fuzz_u8(in),
                                  .modes = fuzz_u8(in) & 0x3Fu,
                                  .order = fuzz_bool(in) ? CW_ORDER_FIFO : CW_ORDER_PRIORITY,
                                  .queue = (uint16_t)(1 + fuzz_below(in, CW_QUEUE_MAX)),
                                  .warning_limit = (uint16_t)(1 + fuzz_below(in, 255)),
                                  .restart_ticks = fuzz_u8(in) * UINT64_C(10000)};
    REQUIRE(inputs_set(&w->inputs, node, &settings) == CW_OK);
}

static void operate_on_rule(world *w, unsigned rule, bool clear)
{
    const cfg *config = live_config(w->live);
    if (rule >= config->rule_count || !config->rules[rule].name)
        return;
    if (clear)
        inputs_clear(&w->inputs, rule);
    else
        (void)inputs_fire(&w->inputs, rule);
}

/* Does what numbers say until they are used up. */
static void operate(world *w, fuzz_input *in)
{
    const unsigned nodes = (unsigned)live_config(w->live)->node_count;
    for (unsigned i = 0; i < OPERATIONS_MAX && in->left > 0; i++) {
        unsigned what = fuzz_u8(in);
        unsigned node = fuzz_below(in, nodes);
        const cw_frame frame = fuzz_frame(in);
        if (what < 128)
            (void)inputs_send(&w->inputs, node, &frame,
                              cw_bus_now(w->inputs.bus) + what * UINT64_C(1000));
        else if (what < 180)
            run(w, what - 127u);
        else if (what < 200)
            set(w, node, in);
        else if (what < 216)
            inputs_attach(&w->inputs, node, what % 2);
        else if (what < 232)
            operate_on_rule(w, fuzz_u8(in), what % 2);
        else
            (void)inputs_restart(&w->inputs, node);
    }
}

static void add_file(cfg_file *files, size_t *count, const fuzz_part *part)
{
    size_t i = 0;
    while (i < *count && strcmp(files[i].name, part->head) != 0)
        i++;
    files[i] = (cfg_file){.name = part->head, .text = part->text, .size = part->size};
    *count += i == *count;
    for (; i > 0 && strcmp(part->head, "bus.yaml") == 0; i--) { /* it comes first */
        const cfg_file other = files[i];
        files[i] = files[i - 1];
        files[i - 1] = other;
    }
}

static void play(world *w, const fuzz_part *parts, size_t part_count)
{
    cfg_file files[FUZZ_PARTS_MAX];
    size_t count = 0;
    w->out = open_memstream(&w->text, &w->size);
    REQUIRE(w->out != NULL);
    for (size_t i = 1; i < part_count; i++) {
        const fuzz_part *part = &parts[i];
        fuzz_input in = {.data = (const uint8_t *)part->text, .left = part->size};
        if (strchr(part->head, '.'))
            add_file(files, &count, part);
        else if (strcmp(part->head, "reload") == 0)
            reload(w, files, count);
        if (!w->live || strchr(part->head, '.'))
            continue;
        if (strcmp(part->head, "inject") == 0)
            inject(w, part);
        else
            operate(w, &in);
        run(w, 200);
    }
    if (w->live)
        check_books(w);
    REQUIRE(fclose(w->out) == 0);
    release_plan_free(w->plan);
    live_free(w->live);
    free(w->memory);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    fuzz_part parts[FUZZ_PARTS_MAX];
    world stepped = {.stepping = true, .bits_left = BITS_MAX};
    world fast = {.bits_left = BITS_MAX};
    size_t count = fuzz_split(parts, data, size);
    play(&stepped, parts, count);
    play(&fast, parts, count);
    REQUIRE(stepped.size == fast.size && memcmp(stepped.text, fast.text, fast.size) == 0);
    free(stepped.text);
    free(fast.text);
    return 0;
}
