/* SPDX-License-Identifier: MIT
 *
 * svg_notes.c - the notes beside the levels of a picture: events of nodes, hits of rules.
 */
#include "cli/svg/svg_notes.h"

#include "record/bitpart.h"
#include "trace/frametext.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

void notes_init(note_list *self, const cfg *config, const cw_bus *bus)
{
    *self = (note_list){.config = config, .end = cw_bus_now(bus)};
    for (unsigned i = 0; i < config->node_count; i++) {
        cw_node_stats stats;
        cw_status status = cw_node_get_stats(bus, i, &stats);
        assert(status == CW_OK);
        (void)status;
        self->before[i].state = stats.state;
        self->before[i].tec = stats.tec;
        self->before[i].rec = stats.rec;
    }
}

void notes_free(note_list *self)
{
    free(self->list);
    self->list = NULL;
}

size_t note_bit(const note *self)
{
    return self->node == NOTE_OF_BUS ? self->half / 2 : self->half / 2 - 1;
}

/* Adds a note behind the earlier notes of the same lane. */
static bool add_note(note_list *self, const note *added)
{
    if (self->count == self->capacity) {
        size_t capacity = self->capacity ? 2 * self->capacity : 64;
        note *list = realloc(self->list, capacity * sizeof *list);
        if (!list)
            return false;
        self->list = list;
        self->capacity = capacity;
    }
    size_t place = self->count++;
    for (; place > 0 && self->list[place - 1].half > added->half; place--)
        self->list[place] = self->list[place - 1];
    self->list[place] = *added;
    return true;
}

/* Appends to the text of a note, after a comma. */
static void append(note *self, note_kind kind, const char *text)
{
    size_t used = strlen(self->text);
    int written = snprintf(self->text + used, NOTE_TEXT_MAX - used, "%s%s", used ? ", " : "", text);
    if (used + (size_t)written >= NOTE_TEXT_MAX)
        memcpy(self->text + NOTE_TEXT_MAX - 4, "...", 4);
    if (kind > self->kind)
        self->kind = kind;
}

/* Appends what happens to a frame, and the frame as candump writes it. */
static void append_frame(note *self, note_kind kind, const char *what, const cw_event *event)
{
    char frame[FRAME_TEXT_MAX];
    char text[FRAME_TEXT_MAX + 64];
    text_print_frame(frame, &event->frame);
    snprintf(text, sizeof text, "%s %s", what, frame);
    append(self, kind, text);
}

/* Appends an event. An error, a state and a change of counters alone are visible at the bit
 * itself. */
static void append_event(note *self, const cw_event *event)
{
    char text[64];
    switch (event->kind) {
    case CW_EVENT_DROP:
        snprintf(text, sizeof text, "dropped (%s)", cw_drop_name(event->why));
        append_frame(self, NOTE_LOST, text, event);
        break;
    case CW_EVENT_RESTART:
        append(self, NOTE_STATE, "restart");
        break;
    case CW_EVENT_ARBITRATION_LOST:
        append(self, NOTE_LOST, "arbitration lost");
        break;
    case CW_EVENT_IMPROPER:
        append(self, NOTE_LOST, "improper arbitration");
        break;
    case CW_EVENT_ERROR:
        snprintf(text, sizeof text, "%s error", cw_error_type_name(event->error.type));
        append(self, NOTE_ERROR, text);
        break;
    case CW_EVENT_OVERLOAD:
        append(self, NOTE_OVERLOAD, "overload");
        break;
    case CW_EVENT_EXCEPTION:
        append(self, NOTE_OVERLOAD, "protocol exception");
        break;
    case CW_EVENT_OVERRUN:
        append_frame(self, NOTE_LOST, "overrun", event);
        break;
    case CW_EVENT_RX:
        append_frame(self, NOTE_FRAME, "received", event);
        break;
    case CW_EVENT_TX:
        append_frame(self, NOTE_FRAME, "sent", event);
        break;
    case CW_EVENT_WAKE:
        append(self, NOTE_STATE, event->why == CW_WAKE_FRAME  ? "woken by a frame"
                                 : event->why == CW_WAKE_HOST ? "woken by its host"
                                                              : "woken");
        break;
    case CW_EVENT_LINK:
        append(self, NOTE_STATE, event->up ? "link up" : "link down");
        break;
    case CW_EVENT_FAULT:
    case CW_EVENT_TOLERATED:
    case CW_EVENT_STATE:
    case CW_EVENT_SKIP:
    case CW_EVENT_SYNC:
    case CW_EVENT_CAPTURE:
    case CW_EVENT_COUNT:
        break;
    }
}

/* Returns half bits from the start of the picture to the end of the present bit. A tick that is not
 * later than its start gives its start. */
static size_t half_at_end(const note_list *self, uint64_t tick)
{
    return 2 * (self->bits + (tick > self->end));
}

/* Adds the hit of a rule. One that acts on a bit points at its middle, others at its end. */
static bool add_hit(note_list *self, const cw_event *event)
{
    const cw_rule *rule = &self->config->rules[event->rule];
    note hit = {.node = NOTE_OF_BUS, .half = half_at_end(self, event->tick)};
    if (bit_has_hit(rule) && hit.half > 0)
        hit.half--;
    append(&hit, NOTE_FAULT, rule->name);
    return add_note(self, &hit);
}

bool notes_event(note_list *self, const cw_event *event)
{
    if (event->kind == CW_EVENT_FAULT)
        return add_hit(self, event);
    for (size_t i = 0; i < self->config->node_count; i++)
        if (event->nodes >> i & 1u)
            append_event(&self->pending[i], event);
    return true;
}

/* Adds what has changed at a node since the bit before: counters and state. */
static void append_changes(note_list *self, unsigned node, const cw_bit_node *now)
{
    note *n = &self->pending[node];
    char text[16];
    if (self->before[node].tec != now->tec) {
        snprintf(text, sizeof text, "TEC %u", now->tec);
        append(n, NOTE_COUNTERS, text);
    }
    if (self->before[node].rec != now->rec) {
        snprintf(text, sizeof text, "REC %u", now->rec);
        append(n, NOTE_COUNTERS, text);
    }
    if (self->before[node].state != now->state)
        append(n, NOTE_STATE, cw_state_name(now->state));
    self->before[node].tec = now->tec;
    self->before[node].rec = now->rec;
    self->before[node].state = now->state;
}

bool notes_bit(note_list *self, const cw_bit_view *bit)
{
    bool good = true;
    for (unsigned i = 0; i < bit->node_count; i++) {
        note *n = &self->pending[i];
        append_changes(self, i, &bit->nodes[i]);
        if (n->text[0] == '\0')
            continue;
        n->node = i;
        n->half = 2 * (self->bits + 1);
        good = add_note(self, n) && good;
        *n = (note){.half = 0};
    }
    self->bits++;
    self->end = bit->end;
    return good;
}
