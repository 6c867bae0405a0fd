/* SPDX-License-Identifier: MIT
 *
 * fake_engine.h - an engine for tests of the control socket: a real bus whose time goes on with
 * each engine_update(). It takes the place of engine/engine.c in the program that includes it,
 * once.
 */
#ifndef CANWIRE_TEST_FAKE_ENGINE_H
#define CANWIRE_TEST_FAKE_ENGINE_H

#include "engine/engine.h"
#include "serve/control.h"

#include <stdlib.h>
#include <string.h>

struct engine {
    const cfg *config;
    void *memory;
    cw_bus *bus;
    inputs inputs;
    unsigned update_bits; /* by which time goes on */
    engine_observer *observer;
    void *observer_user;
    const char *reload_errors; /* NULL: a reload is good */
    bool reload_in_turn;       /* ... and so is every second one */
    uint64_t reloads;          /* rounds that were asked for */
    uint64_t answered;         /* ... and have finished */
};

static void fake_engine_take_events(void *user)
{
    engine *e = user;
    cw_event event;
    while (cw_bus_poll(e->bus, &event))
        if (e->observer)
            e->observer(e->observer_user, &event);
}

/* Makes the bus of a configuration, with room for more rules than it has. Returns false without
 * memory or a bus. `memory` is to be freed. */
static bool fake_engine_make(engine *e, live *config_of, uint16_t more_rules, unsigned update_bits)
{
    cw_node_config nodes[CW_NODES_MAX];
    cw_bus_config bus_config;
    *e = (engine){.config = live_config(config_of), .update_bits = update_bits};
    cfg_bus_config(&bus_config, nodes, e->config);
    bus_config.rule_room = more_rules;
    e->memory = malloc(cw_bus_size(&bus_config));
    e->bus = e->memory ? cw_bus_init(e->memory, &bus_config) : NULL;
    if (e->bus)
        inputs_init(&e->inputs, config_of, e->bus, fake_engine_take_events, e);
    return e->bus != NULL;
}

void engine_update(engine *e)
{
    uint64_t target = cw_bus_now(e->bus) + cw_rate_ticks(e->config->rate, e->update_bits);
    inputs_advance(&e->inputs, target);
}

inputs *engine_change(engine *e)
{
    engine_update(e);
    return &e->inputs;
}

const cw_bus *engine_bus(const engine *e)
{
    return e->bus;
}

void engine_report(const engine *e, report *out)
{
    (void)e;
    memset(out, 0, sizeof *out);
}

void engine_observe(engine *e, engine_observer *observer, void *user)
{
    e->observer = observer;
    e->observer_user = user;
}

void engine_set_events(engine *e, uint32_t kinds)
{
    cw_bus_set_events(e->bus, CW_EVENTS_USUAL | kinds);
}

/* Asks for a reload, as a control_reload; user is the engine. The next fake_engine_answer() ends
 * it. */
static uint64_t fake_engine_ask(void *user, FILE *errors)
{
    engine *e = user;
    (void)errors;
    return ++e->reloads;
}

static void fake_engine_answer(engine *e, control *c)
{
    while (e->answered < e->reloads) {
        bool refused = e->reload_errors && (!e->reload_in_turn || e->answered % 2 == 0);
        control_reloaded(c, ++e->answered, refused ? e->reload_errors : NULL);
    }
}

#endif
