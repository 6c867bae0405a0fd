/* SPDX-License-Identifier: MIT
 *
 * load.c - makes and frees instances, and puts them back to time 0.
 */
#include "embed/embed.h"

#include "base/version.h"
#include "config/doubts.h"
#include "run/bus_make.h"

#include <stdlib.h>

int canwire_sim_abi(void)
{
    return CANWIRE_SIM_ABI;
}

const char *canwire_sim_version(void)
{
    return CANWIRE_VERSION;
}

void canwire_sim_free_text(char *text)
{
    free(text);
}

/* ---- Buses ----------------------------------------------------------------------------------- */

static void load_drain(void *user)
{
    embed_bus *b = user;
    sim_pass_on(&b->run, NULL);
}

/* Keeps the bit timings of the configuration, to which a restart returns, and makes the inboxes of
 * hosts. */
static bool keep_times(embed_bus *b)
{
    b->times = calloc(b->config->node_count, sizeof *b->times);
    b->nodes = calloc(b->config->node_count, sizeof *b->nodes);
    if (!b->times || !b->nodes)
        return false;
    for (size_t i = 0; i < b->config->node_count; i++)
        b->times[i] = b->config->nodes[i].time;
    return true;
}

/* Opens a bus and takes its configuration over, also when it fails. Writes its warnings. */
static bool load_open_bus(canwire_sim *sim, cfg *config, FILE *out)
{
    embed_bus *b = &sim->buses[sim->count];
    const sim_sink sink = {.user = b, .event = embed_event, .kinds = CW_EVENTS_USUAL};
    fputs(config->warnings, out);
    b->sim = sim;
    b->index = sim->count;
    b->first_node = b->index > 0 ? b[-1].first_node + (int)b[-1].config->node_count : 0;
    b->live = live_new(config);
    if (!b->live) {
        cfg_free(config);
        return false;
    }
    sim->count++;
    b->config = live_config(b->live);
    b->seed = b->config->seed;
    b->lost = (losses){.config = b->config, .fed = doubts_fed(sim->rig, b->index)};
    if (!keep_times(b) || !sim_open_roomy(&b->run, b->config, sim->told.out))
        return false;
    sim_add_sink(&b->run, &sink);
    inputs_init(&b->in, b->live, b->run.bus, load_drain, b);
    sim->group.runs[sim->group.count++] = &b->run;
    return embed_judge_start(b);
}

/* Frees what a bus has beside its configuration, also after it was opened in part. */
static void close_bus(embed_bus *b)
{
    embed_judge_end(b);
    sim_close(&b->run);
    for (size_t i = 0; b->nodes && i < b->config->node_count; i++)
        free(b->nodes[i].frames);
    free(b->events.bytes);
    free(b->ahead);
    free(b->nodes);
    free(b->times);
    live_free(b->live);
}

/* ---- Instances ------------------------------------------------------------------------------- */

/* Takes the configuration of a bus out of the rig, or the only one. */
static cfg *take_config(canwire_sim *sim, size_t bus, cfg **alone)
{
    cfg **from = sim->rig ? &sim->rig->buses[bus] : alone;
    cfg *config = *from;
    *from = NULL;
    return config;
}

/* Opens all buses of a rig, or the one bus `alone`, which it takes. All of them begin in step. */
static bool open_all(canwire_sim *sim, cfg *alone, FILE *out)
{
    const size_t count = sim->rig ? sim->rig->bus_count : 1;
    bool good = true;
    sim->kinds = CW_EVENTS_USUAL;
    sim->buses = calloc(count, sizeof *sim->buses);
    good = memo_begin(&sim->told) && sim->buses && sim_group_open(&sim->group, sim->rig);
    for (size_t i = 0; i < count && good; i++) {
        cfg *config = take_config(sim, i, &alone);
        good = config && load_open_bus(sim, config, out);
    }
    cfg_free(alone);
    if (good)
        sim_group_begin(&sim->group);
    return good;
}

/* Loads a configuration or a rig. Returns NULL after a line that says why. */
static canwire_sim *load_configuration(const cfg_file *file, FILE *out)
{
    rig *buses;
    cfg *alone;
    if (!rig_load_either(&buses, &alone, file, out))
        return NULL;
    canwire_sim *sim = calloc(1, sizeof *sim);
    if (sim) {
        sim->rig = buses;
        if (open_all(sim, alone, out))
            return sim;
    } else {
        cfg_free(alone);
        rig_free(buses);
    }
    fprintf(out, "%s: %s\n", file->name, bus_why_not());
    canwire_sim_free(sim);
    return NULL;
}

void embed_tell_end(memo *t, char **messages)
{
    char *text = memo_take(t);
    const bool any = text && *text;
    if (messages)
        *messages = any ? text : NULL;
    if (!messages || !any)
        free(text);
}

/* Loads, and hands over all messages about it: errors, or the warnings of a good file. */
static canwire_sim *load_telling(const cfg_file *file, char **messages)
{
    memo t;
    canwire_sim *sim = memo_begin(&t) ? load_configuration(file, t.out) : NULL;
    embed_tell_end(&t, messages);
    return sim;
}

canwire_sim *canwire_sim_load(const char *file, char **messages)
{
    return load_telling(&(cfg_file){.name = file}, messages);
}

canwire_sim *canwire_sim_load_text(const char *text, size_t size, const char *name,
                                   char **messages)
{
    return load_telling(&(cfg_file){.name = name, .text = text, .size = size}, messages);
}

void canwire_sim_free(canwire_sim *sim)
{
    if (!sim)
        return;
    for (size_t i = 0; i < sim->count; i++)
        close_bus(&sim->buses[i]);
    sim_group_close(&sim->group);
    rig_free(sim->rig);
    memo_end(&sim->told);
    free(sim->buses);
    free(sim->message);
    free(sim);
}

/* ---- Restart --------------------------------------------------------------------------------- */

/* Makes a bus as it was when it was loaded, with another seed if there is one. Its memory stays. */
static void load_forget(embed_bus *b, const uint64_t *seed)
{
    embed_judge_end(b);
    live_restart(b->live, seed ? *seed : b->seed);
    losses_forget(&b->lost);
    for (unsigned i = 0; i < b->config->node_count; i++) {
        live_set_time(b->live, i, &b->times[i]);
        b->nodes[i].first = 0;
        b->nodes[i].count = 0;
        b->nodes[i].limit = (errframe_limit){.used = 0};
    }
    b->events.first = 0;
    b->events.end = 0;
}

int canwire_sim_reset(canwire_sim *sim, const uint64_t *seed)
{
    bool good = true;
    for (size_t i = 0; i < sim->count; i++)
        load_forget(&sim->buses[i], seed);
    sim->reached = 0;
    sim->no_memory = false;
    good = sim_group_restart(&sim->group, sim->rig);
    for (size_t i = 0; i < sim->count && good; i++) {
        embed_bus *b = &sim->buses[i];
        inputs_init(&b->in, b->live, b->run.bus, load_drain, b);
        good = embed_judge_start(b);
    }
    sim->no_memory = !good;
    return good ? CANWIRE_SIM_OK : embed_fail(sim, CANWIRE_SIM_NO_MEMORY, "%s", bus_why_not());
}
