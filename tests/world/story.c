/* SPDX-License-Identifier: MIT
 *
 * story.c - what a seed is about: some kinds of trouble of many, so that each gets room, on a bus
 * of its own.
 */
#include "world.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define FLOOD_RULES 1000u

story the_story;

static const char *const pacings[] = {"precise", "tick", "spin"};
static const unsigned bitrates[] = {125000, 250000, 500000, 1000000};

static void draw_machine(void)
{
    world->work_ps = 1500 + (unsigned)world_draw(3000);
    world->preempt_permille = world_chance(300) ? 0 : 1 + (unsigned)world_draw(20);
    world->late_us = 1 + (unsigned)world_between(1, 3000);
    world->interrupt_permille = world_chance(500) ? (unsigned)world_between(1, 60) : 0;
}

/* Draws troubles: the expensive ones each on its own; the others in any combination. */
static void draw_trouble(story *s)
{
    switch (world_draw(10)) {
    case 0:
        s->twins = true;
        world->preempt_permille = 100 + (unsigned)world_draw(300);
        break;
    case 1:
        s->restarts = true;
        s->length_ns = 2500 * MS;
        break;
    case 2:
        s->fifo = true;
        break;
    case 3:
        s->hung_file = true;
        break;
    case 4:
        s->full_disk = true;
        break;
    case 5:
        s->flood = true;
        break;
    case 6:
        *(world_chance(500) ? &s->bad_disk : &s->slow_disk) = true;
        break;
    case 7:
        *(world_chance(500) ? &s->hung_disk : &s->power) = true;
        break;
    default: /* of a number: nothing of it */
        break;
    }
}

void story_draw(void)
{
    story *s = &the_story;
    *s = (story){.length_ns = 600 * MS + (int64_t)world_draw(1400 * MS),
                 .ecus = 2 + (unsigned)world_draw(ECUS_MAX - 1),
                 .bitrate = bitrates[world_draw(4)],
                 .pacing = pacings[world_draw(8) < 6 ? 0 : world_draw(3)]};
    draw_machine();
    draw_trouble(s);
    s->journal = s->restarts || s->full_disk || s->power || world_chance(850);
    s->watch = world_chance(900);
    s->record = world_chance(400);
    s->reloads = world_chance(300);
    s->faults = world_chance(500);
    s->hostile = world_chance(250);
    s->idlers = world_chance(150);
    s->stops = world_chance(120);
    s->clock_steps = world_chance(150);
    s->vanishing = world_chance(250);
    s->deaf_ecus = world_chance(150);
    s->refusals = world_chance(150);
    if (s->refusals)
        world->refuse_permille = (unsigned)world_between(1, 40);
}

const char *story_name(void)
{
    static char name[300];
    const story *s = &the_story;
    const struct {
        bool on;
        const char *word;
    } words[] = {
        {s->journal, "journal"},   {s->record, "record"},       {s->watch, "watch"},
        {s->twins, "twins"},       {s->restarts, "restarts"},   {s->full_disk, "full-disk"},
        {s->bad_disk, "bad-disk"}, {s->slow_disk, "slow-disk"}, {s->hung_disk, "hung-disk"},
        {s->power, "power"},       {s->fifo, "fifo"},           {s->hung_file, "hung-file"},
        {s->reloads, "reloads"},   {s->flood, "flood"},         {s->hostile, "hostile"},
        {s->idlers, "idlers"},     {s->faults, "faults"},       {s->stops, "stops"},
        {s->clock_steps, "clock"}, {s->vanishing, "vanishing"}, {s->deaf_ecus, "deaf"},
        {s->refusals, "refusals"},
    };
    int used = snprintf(name, sizeof name, "%u ECUs, %u bit/s, %s", s->ecus, s->bitrate, s->pacing);
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++)
        if (words[i].on)
            used += snprintf(name + used, sizeof name - (size_t)used, ", %s", words[i].word);
    return name;
}

/* ---- The configuration ----------------------------------------------------------------------- */

static void write_nodes(FILE *out, unsigned version)
{
    fputs("nodes:\n", out);
    for (unsigned i = 0; i < the_story.ecus; i++)
        fprintf(out,
                "  - { name: e%u, port: \"unix:" WORLD_ROOT
                "run/e%u.sock\", queue: 256, restart-ms: %d }\n",
                i, i, 20);
    fprintf(out, "  - name: load\n    traffic:\n      - { send: \"700#%02X\", every: %ums }\n",
            version & 0xffu, 5 + (unsigned)world_draw(40));
    if (the_story.flood && version > 0)
        fputs("      - { send: \"7F0#11\", every: 1ns, count: 2000000 }\n", out);
}

static const char *const fault_texts[] = {
    "when: { frame: \"#FFFFFFFF\" }\n    do: { error-flag: e1 }",
    "when: { every: 7 }\n    do: { flip: \"crc[3]\" }",
    "when: { every: 11 }\n    do: { flip: ack-slot, at: [e0] }",
    "do: { noise: 1e-4 }",
    "when: { from: e0, skip: 20, every: 30 }\n    do: { drop: tx }",
    "when: { from: e1, every: 9 }\n    do: { duplicate: 2 }",
    "when: { from: e1, every: 5 }\n    do: { delay: 2ms }",
    "when: { time: 300ms }\n    do: { disconnect: e1, for: 50ms }",
    "when: { time: 700ms }\n    do: { bus-off: e0 }",
    "do: { send: \"6F0#01\", as: load, every: 3ms }",
};

static void write_faults(FILE *out, unsigned version)
{
    const unsigned known = sizeof fault_texts / sizeof fault_texts[0];
    if (!the_story.faults && !the_story.flood)
        return;
    fputs("faults:\n", out);
    if (the_story.flood && version > 0)
        for (unsigned i = 0; i < FLOOD_RULES; i++)
            fprintf(out, "  - { name: f%u, do: { send: \"6%02X#\", as: load, every: 1ns } }\n", i,
                    i % 256);
    else
        fputs("  - { name: none, when: { manual: yes }, do: { send: \"6FF#\", as: load } }\n", out);
    for (unsigned i = 0; the_story.faults && i < 3; i++)
        fprintf(out, "  - name: rule%u\n    %s\n", i, fault_texts[world_draw(known)]);
}

void story_write_config(unsigned version)
{
    FILE *out = fopen("bus.yaml.new", "w");
    fprintf(out, "bus: { name: w, bitrate: %u }\ncontrol: " WORLD_ROOT "run/w.sock\npacing: %s\n",
            the_story.bitrate, the_story.pacing);
    write_nodes(out, version);
    write_faults(out, version);
    if (the_story.record)
        fprintf(out, "record:\n  - { file: " WORLD_ROOT "log/rec%u.log }\n", version % 3);
    (void)fclose(out);
    (void)rename("bus.yaml.new", "bus.yaml");
    world->config_is_bad = false;
    world_trace("writes bus.yaml, version %u", version);
}
