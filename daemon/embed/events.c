/* SPDX-License-Identifier: MIT
 *
 * events.c - keeps the events of buses in virtual time until a program takes them, as text.
 */
#include "embed/embed.h"

#include "record/output.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#define BYTES_FIRST 16384u

/* ---- Kinds ----------------------------------------------------------------------------------- */

/* Returns the kind of event that a word names, or -1. Tolerated dominant bits are not shown. */
static int events_find_kind(const char *word, size_t length)
{
    for (unsigned kind = 0; kind < CW_EVENT_COUNT; kind++) {
        const char *name = cw_event_name((cw_event_kind)kind);
        if (kind != CW_EVENT_TOLERATED && strlen(name) == length &&
            strncmp(name, word, length) == 0)
            return (int)kind;
    }
    return -1;
}

bool embed_read_kinds(canwire_sim *sim, uint32_t *kinds, const char *text)
{
    const bool all = strcmp(text, "all") == 0;
    *kinds = all ? CW_EVENTS_USUAL : 0;
    if (all || strcmp(text, "none") == 0)
        return true;
    while (*text) {
        const size_t length = strcspn(text, ",");
        const int kind = events_find_kind(text, length);
        if (kind < 0) {
            (void)embed_fail(sim, CANWIRE_SIM_INVALID, "there is no event '%.*s'; expected all, "
                             "none, or names with commas, such as error,state,fault",
                             (int)length, text);
            return false;
        }
        *kinds |= 1u << kind;
        text += length;
        text += *text == ',';
    }
    return true;
}

int canwire_sim_keep_events(canwire_sim *sim, const char *text)
{
    uint32_t kinds = 0;
    if (!embed_read_kinds(sim, &kinds, text))
        return CANWIRE_SIM_INVALID;
    sim->kinds = kinds;
    for (size_t i = 0; i < sim->count; i++)
        embed_choose_events(&sim->buses[i]);
    return CANWIRE_SIM_OK;
}

/* ---- What is kept ---------------------------------------------------------------------------- */

/* Returns the bytes of an event that count. */
static size_t length_of(const cw_event *event)
{
    const uint32_t with_frame = 1u << CW_EVENT_ARBITRATION_LOST | 1u << CW_EVENT_IMPROPER |
                                1u << CW_EVENT_DROP | 1u << CW_EVENT_OVERRUN | 1u << CW_EVENT_RX |
                                1u << CW_EVENT_TX | 1u << CW_EVENT_CAPTURE;
    if (!(with_frame >> event->kind & 1u))
        return offsetof(cw_event, frame);
    return offsetof(cw_event, frame.data) + cw_frame_length(&event->frame);
}

/* The name of the rule is kept with the event: another rule may have its number later. */
static size_t name_offset(const cw_event *event)
{
    return offsetof(embed_kept, event) + length_of(event);
}

const char *embed_rule_of(const embed_kept *kept)
{
    return (const char *)kept + name_offset(&kept->event);
}

/* Makes room for so many bytes. Returns false without memory. */
static bool events_grow(embed_events *e, size_t size)
{
    const size_t used = e->end - e->first;
    if (e->first > 0) {
        memmove(e->bytes, e->bytes + e->first, used);
        e->first = 0;
        e->end = used;
    }
    if (used + size <= e->room / 2) /* so that moves stay rare */
        return true;
    const size_t room = e->room ? 2 * e->room : BYTES_FIRST;
    unsigned char *bytes = realloc(e->bytes, room);
    if (!bytes)
        return false;
    e->bytes = bytes;
    e->room = room;
    return true;
}

void embed_keep(embed_bus *b, const cw_event *event)
{
    const size_t align = _Alignof(embed_kept);
    embed_events *e = &b->events;
    const char *name = "";
    if (event->kind == CW_EVENT_TOLERATED) /* events do not show it */
        return;
    if (event->kind == CW_EVENT_FAULT)
        name = b->config->rules[event->rule].name;
    const size_t at = name_offset(event);
    const size_t size = (at + strlen(name) + align) / align * align;
    assert(size <= BYTES_FIRST / 2);
    if (e->end + size > e->room && !events_grow(e, size)) {
        b->sim->no_memory = true;
        return;
    }
    unsigned char *kept = e->bytes + e->end;
    memcpy(kept, &size, sizeof size);
    memcpy(kept + offsetof(embed_kept, event), event, length_of(event));
    memcpy(kept + at, name, strlen(name) + 1);
    e->end += size;
}

/* ---- What is taken --------------------------------------------------------------------------- */

/* Returns an event by its byte. */
static const embed_kept *kept_at(const embed_events *e, size_t at)
{
    return (const embed_kept *)(const void *)(e->bytes + at);
}

const embed_kept *embed_kept_after(const embed_bus *b, const embed_kept *kept)
{
    const embed_events *e = &b->events;
    const size_t at = kept ? (size_t)((const unsigned char *)kept - e->bytes) + kept->size
                           : e->first;
    return at < e->end ? kept_at(e, at) : NULL;
}

const embed_kept *embed_next_kept(const canwire_sim *sim, embed_bus **bus)
{
    const embed_kept *next = NULL;
    uint64_t first = sim->reached;
    for (size_t i = 0; i < sim->count; i++) {
        embed_bus *b = &sim->buses[i];
        if (b->events.first == b->events.end)
            continue;
        const embed_kept *kept = kept_at(&b->events, b->events.first);
        if (kept->event.tick > first || (next && kept->event.tick == first))
            continue;
        *bus = b;
        next = kept;
        first = kept->event.tick;
    }
    return next;
}

void embed_take_kept(embed_bus *b)
{
    embed_events *e = &b->events;
    e->first += kept_at(e, e->first)->size;
    if (e->first == e->end)
        e->first = e->end = 0;
}

int64_t canwire_sim_count_events(const canwire_sim *sim)
{
    int64_t rows = 0;
    for (size_t i = 0; i < sim->count; i++) {
        const embed_events *e = &sim->buses[i].events;
        for (size_t at = e->first; at < e->end; at += kept_at(e, at)->size) {
            const cw_event *event = &kept_at(e, at)->event;
            if (event->tick > sim->reached)
                break;
            rows += event->nodes ? __builtin_popcountll(event->nodes) : 1;
        }
    }
    return rows;
}

/* Writes a hit with the name that its rule had then. */
static void write_fault(FILE *out, const embed_bus *b, const embed_kept *kept)
{
    cw_rule rule = {.name = embed_rule_of(kept)};
    cw_event event = {.rule = 0};
    cfg view = *b->config;
    memcpy(&event, &kept->event, length_of(&kept->event));
    event.rule = 0;
    view.rules = &rule;
    view.rule_count = 1;
    if (b->sim->rig)
        output_event_of_bus(out, &view, &event);
    else
        output_event(out, &view, &event);
}

/* Writes an event as a line, as `canwire sim --events` does: those of a rig name their bus. */
static void write_event(FILE *out, const embed_bus *b, const embed_kept *kept)
{
    if (kept->event.kind == CW_EVENT_FAULT)
        write_fault(out, b, kept);
    else if (b->sim->rig)
        output_event_of_bus(out, b->config, &kept->event);
    else
        output_event(out, b->config, &kept->event);
}

char *canwire_sim_take_events(canwire_sim *sim, size_t *size)
{
    memo text;
    embed_bus *b;
    size_t length = 0;
    if (sim->no_memory || !memo_begin(&text))
        return NULL;
    for (const embed_kept *kept; (kept = embed_next_kept(sim, &b));) {
        write_event(text.out, b, kept);
        embed_take_kept(b);
    }
    sim->no_memory = ferror(text.out) || !memo_text(&text);
    length = text.size;
    char *taken = memo_take(&text);
    sim->no_memory = sim->no_memory || !taken;
    if (size)
        *size = length;
    return taken;
}
