/* SPDX-License-Identifier: MIT
 *
 * columns.c - the events of buses in virtual time as numbers: a column for each property.
 */
#include "embed/embed.h"

#include "base/text/number.h"

#include <stdlib.h>
#include <string.h>

/* ---- Words ----------------------------------------------------------------------------------- */

/* The first word of each sort. */
enum {
    WORD_EVENT = 1,
    WORD_STATE = WORD_EVENT + CW_EVENT_COUNT,
    WORD_ERROR = WORD_STATE + CW_STATE_COUNT,
    WORD_DROP = WORD_ERROR + CW_ERROR_COUNT,
    WORD_WAKE = WORD_DROP + CW_DROP_COUNT,
    WORD_LINK = WORD_WAKE + CW_WAKE_COUNT, /* down, up */
    WORD_FIELD = WORD_LINK + 2,
    WORDS = WORD_FIELD + CW_FIELD_COUNT
};

_Static_assert(WORDS <= UINT8_MAX + 1, "words are numbers of one byte");

const char *canwire_sim_word(int n)
{
    if (n < 0 || n >= WORDS)
        return NULL;
    if (n < WORD_EVENT)
        return "";
    if (n < WORD_STATE)
        return cw_event_name((cw_event_kind)(n - WORD_EVENT));
    if (n < WORD_ERROR)
        return cw_state_name((cw_state)(n - WORD_STATE));
    if (n < WORD_DROP)
        return cw_error_type_name((cw_error_type)(n - WORD_ERROR));
    if (n < WORD_WAKE)
        return cw_drop_name((cw_drop)(n - WORD_DROP));
    if (n < WORD_LINK)
        return cw_wake_name((cw_wake)(n - WORD_WAKE));
    if (n < WORD_FIELD)
        return n == WORD_LINK ? "down" : "up";
    return cw_field_name((cw_field)(n - WORD_FIELD));
}

/* ---- Rows ------------------------------------------------------------------------------------ */

/* The properties that all rows of an event have. */
typedef struct row {
    int64_t t;
    int16_t bus;
    uint8_t event;
    uint8_t detail;
    uint8_t field;
    uint8_t marks;
    uint32_t number;
    uint16_t rule;
    uint16_t tec;
    uint16_t rec;
    canwire_sim_frame frame;
    uint32_t error_id;
} row;

/* Sets what an error frame tells: detail, field and marks as words and bits of canwire-sim.h. */
static void set_row_error(row *r, const cw_event *event)
{
    const cw_error *error = &event->error;
    r->detail = (uint8_t)(WORD_ERROR + error->type);
    r->field = (uint8_t)(WORD_FIELD + error->place.field);
    r->number = error->place.index;
    r->marks = (uint8_t)((error->role == CW_ROLE_TRANSMITTER ? CANWIRE_SIM_MARK_TX : 0) |
                         (error->place.stuff ? CANWIRE_SIM_MARK_STUFF : 0) |
                         (event->fast ? CANWIRE_SIM_MARK_DATA : 0) |
                         (error->flag == CW_FLAG_ACTIVE ? CANWIRE_SIM_MARK_ACTIVE : 0) |
                         (error->flag == CW_FLAG_PASSIVE ? CANWIRE_SIM_MARK_PASSIVE : 0));
    r->tec = event->tec;
    r->rec = event->rec;
    if (event->from)
        r->error_id = event->can_id; /* cw_frame_can_id() has the flags of linux/can.h */
}

/* Sets what only some kinds of events have, but for the rule. */
static void set_row_details(row *r, const cw_event *event)
{
    switch (event->kind) {
    case CW_EVENT_FAULT:
        r->number = event->hit;
        break;
    case CW_EVENT_LINK:
        r->detail = (uint8_t)(WORD_LINK + event->up);
        break;
    case CW_EVENT_DROP:
        r->detail = (uint8_t)(WORD_DROP + event->why);
        embed_frame_from(&r->frame, &event->frame);
        break;
    case CW_EVENT_ARBITRATION_LOST:
        r->number = event->lost_bit;
        embed_frame_from(&r->frame, &event->frame);
        break;
    case CW_EVENT_ERROR:
        set_row_error(r, event);
        break;
    case CW_EVENT_IMPROPER:
    case CW_EVENT_OVERRUN:
    case CW_EVENT_RX:
    case CW_EVENT_TX:
    case CW_EVENT_CAPTURE:
        embed_frame_from(&r->frame, &event->frame);
        break;
    case CW_EVENT_WAKE:
        r->detail = (uint8_t)(WORD_WAKE + event->why);
        break;
    case CW_EVENT_STATE:
        r->detail = (uint8_t)(WORD_STATE + event->state);
        r->tec = event->tec;
        r->rec = event->rec;
        break;
    case CW_EVENT_RESTART:
    case CW_EVENT_OVERLOAD:
    case CW_EVENT_EXCEPTION:
    case CW_EVENT_SKIP:
    case CW_EVENT_SYNC:
    case CW_EVENT_TOLERATED:
    case CW_EVENT_COUNT:
        break;
    }
}

#define PUT(column, value)                                                                         \
    if (c->column)                                                                                 \
        c->column[n] = (value)

/* Writes a row into the columns that the caller wants; others are NULL. */
static void put_row(const canwire_sim_columns *c, int64_t n, const row *r, int node)
{
    PUT(t, r->t);
    PUT(bus, r->bus);
    PUT(node, (int16_t)node);
    PUT(event, r->event);
    PUT(detail, r->detail);
    PUT(field, r->field);
    PUT(marks, r->marks);
    PUT(number, r->number);
    PUT(rule, r->rule);
    PUT(tec, r->tec);
    PUT(rec, r->rec);
    PUT(can_id, r->frame.can_id);
    PUT(flags, r->frame.flags);
    PUT(length, r->frame.length);
    PUT(raw_dlc, r->frame.raw_dlc);
    PUT(error_id, r->error_id);
    if (c->data)
        memcpy(c->data + n * c->data_size, r->frame.data, (size_t)c->data_size);
}

/* ---- Names of rules -------------------------------------------------------------------------- */

#define RULES_MAX (UINT16_MAX + 1u) /* numbers in a column */

/* The names of rules with hits. They are those of events that have just been taken. */
typedef struct rule_list {
    const char **names;
    size_t count;
    size_t room;
    size_t last; /* the one that was found last */
} rule_list;

/* Finds the number of a name, or adds it. Returns false without memory, or without a number. */
static bool find_name(rule_list *l, uint16_t *number, const char *name)
{
    size_t i = l->last;
    if (l->count == 0 || strcmp(l->names[i], name) != 0)
        for (i = 0; i < l->count && strcmp(l->names[i], name) != 0;)
            i++;
    if (i == l->room) {
        const size_t room = l->room ? 2 * l->room : 16;
        const char **names = room <= RULES_MAX ? realloc(l->names, room * sizeof *names) : NULL;
        if (!names)
            return false;
        l->names = names;
        l->room = room;
    }
    if (i == l->count)
        l->names[l->count++] = name;
    l->last = i;
    *number = (uint16_t)i;
    return true;
}

/* Returns the names as a text, or NULL when there are none, or without memory. */
static char *join_names(const rule_list *l)
{
    memo text;
    FILE *out = l->count > 0 ? memo_begin(&text) : NULL;
    if (!out)
        return NULL;
    for (size_t i = 0; i < l->count; i++)
        fprintf(out, "%s\n", l->names[i]);
    return memo_take(&text);
}

/* ---- All of it ------------------------------------------------------------------------------- */

/* Puts the rows of an event. Returns false without memory. */
static bool put_event(const canwire_sim_columns *c, int64_t n, rule_list *rules,
                      const embed_bus *b, const embed_kept *kept)
{
    const cw_event *event = &kept->event;
    row r = {.t = (int64_t)text_ticks_ns(event->tick),
             .bus = (int16_t)b->index,
             .event = (uint8_t)(WORD_EVENT + event->kind),
             .frame.can_id = CANWIRE_SIM_NO_FRAME,
             .error_id = CANWIRE_SIM_NO_FRAME};
    set_row_details(&r, event);
    if (event->kind == CW_EVENT_FAULT && !find_name(rules, &r.rule, embed_rule_of(kept)))
        return false;
    if (event->nodes == 0)
        put_row(c, n, &r, -1);
    for (uint64_t rest = event->nodes; rest; rest &= rest - 1)
        put_row(c, n++, &r, b->first_node + __builtin_ctzll(rest));
    return true;
}

int64_t canwire_sim_take_columns(canwire_sim *sim, const canwire_sim_columns *columns, int64_t rows,
                                 char **rules)
{
    rule_list names = {.count = 0};
    embed_bus *b;
    int64_t n = 0;
    bool good = !sim->no_memory;
    if (columns->data && (columns->data_size < 1 || columns->data_size > CW_FRAME_DATA_MAX))
        return embed_fail(sim, CANWIRE_SIM_INVALID, "a row has 1 to %d bytes of data",
                          CW_FRAME_DATA_MAX);
    for (const embed_kept *kept; good && (kept = embed_next_kept(sim, &b));) {
        const uint64_t nodes = kept->event.nodes;
        const int64_t more = nodes ? __builtin_popcountll(nodes) : 1;
        if (more > rows - n)
            break;
        good = put_event(columns, n, &names, b, kept);
        n += more;
        embed_take_kept(b);
    }
    *rules = join_names(&names);
    good = good && (names.count == 0 || *rules);
    free(names.names);
    if (good)
        return n;
    sim->no_memory = true;
    return embed_fail(sim, CANWIRE_SIM_NO_MEMORY, "out of memory");
}
