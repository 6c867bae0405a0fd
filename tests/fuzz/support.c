/* SPDX-License-Identifier: MIT
 *
 * support.c - what the fuzz targets share.
 */
#include "fuzz.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define HASH_START UINT64_C(0xCBF29CE484222325) /* FNV-1a */
#define HASH_PRIME UINT64_C(0x100000001B3)
#define TEC_MAX 263u
#define REC_MAX 255u
#define PAUSE_BITS 250u /* at most, between two frames of random traffic */

void fuzz_fail(const char *file, int line, const char *condition)
{
    fprintf(stderr, "%s:%d: does not hold: %s\n", file, line, condition);
    abort();
}

/* ---- Input ----------------------------------------------------------------------------------- */

uint8_t fuzz_u8(fuzz_input *in)
{
    if (in->left == 0)
        return 0;
    in->left--;
    return *in->data++;
}

uint32_t fuzz_u32(fuzz_input *in)
{
    uint32_t value = 0;
    for (unsigned i = 0; i < 4; i++)
        value = value << 8 | fuzz_u8(in);
    return value;
}

unsigned fuzz_below(fuzz_input *in, unsigned limit)
{
    unsigned value = fuzz_u8(in);
    if (limit > 256)
        value = value << 8 | fuzz_u8(in);
    return value % limit;
}

bool fuzz_bool(fuzz_input *in)
{
    return fuzz_u8(in) & 1u;
}

cw_frame fuzz_frame(fuzz_input *in)
{
    unsigned kind = fuzz_u8(in);
    cw_frame frame = {.flags = kind & 3u, .dlc = (uint8_t)(kind >> 2 & 15u)};
    bool extended = frame.flags & CW_FRAME_EXTENDED;
    frame.id = (extended ? fuzz_u32(in) : fuzz_below(in, 0x900)) & 0x3FFFFFFFu;
    if (kind >> 6 != 3) /* valid */
        frame.id &= extended ? 0x1FFFFFFFu : 0x7FFu;
    for (unsigned i = 0; i < cw_frame_length(&frame); i++)
        frame.data[i] = fuzz_u8(in);
    return frame;
}

char *fuzz_text(const uint8_t *data, size_t size)
{
    char *text = malloc(size + 1);
    REQUIRE(text != NULL);
    if (size > 0)
        memcpy(text, data, size);
    text[size] = '\0';
    return text;
}

static uint64_t mix(uint64_t hash, uint64_t value)
{
    return (hash ^ value) * HASH_PRIME;
}

uint64_t fuzz_hash(const uint8_t *data, size_t size)
{
    uint64_t hash = HASH_START;
    for (size_t i = 0; i < size; i++)
        hash = mix(hash, data[i]);
    return hash;
}

uint32_t fuzz_random(uint64_t *state)
{
    *state ^= *state << 13;
    *state ^= *state >> 7;
    *state ^= *state << 17;
    return (uint32_t)(*state >> 32);
}

/* ---- The bus --------------------------------------------------------------------------------- */

static unsigned nodes_with_triggers(const cw_bus_config *config)
{
    unsigned nodes = 0;
    for (unsigned i = 0; i < config->node_count; i++)
        nodes += config->nodes[i].schedule.trigger_count > 0;
    return nodes;
}

bool fuzz_bus_open(fuzz_bus *b, const cw_bus_config *config)
{
    size_t size = cw_bus_size(config);
    *b = (fuzz_bus){.nodes = config->node_count,
                    .triggering = size > 0 ? nodes_with_triggers(config) : 0,
                    .bit_ticks = config->bit_ticks,
                    .hash = HASH_START,
                    .trace = getenv("FUZZ_TRACE") != NULL,
                    .label = '-'};
    if (size == 0)
        return false;
    b->memory = malloc(size);
    REQUIRE(b->memory != NULL);
    b->bus = cw_bus_init(b->memory, config);
    if (!b->bus)
        fuzz_bus_close(b);
    return b->bus != NULL;
}

/* Returns true when each node of the old bus goes on. */
static bool all_go_on(unsigned old_nodes, const uint8_t *from, unsigned nodes)
{
    uint64_t kept = 0;
    for (unsigned i = 0; i < nodes; i++)
        kept |= from[i] == CW_NO_NODE ? 0 : UINT64_C(1) << from[i];
    return (unsigned)__builtin_popcountll(kept) == old_nodes;
}

cw_status fuzz_bus_take_over(fuzz_bus *b, const cw_bus_config *config, const uint8_t *from)
{
    fuzz_bus next;
    REQUIRE(fuzz_bus_open(&next, config));
    cw_status status = cw_bus_take_over(next.bus, b->bus, from);
    fuzz_bus *discarded = status == CW_OK ? b : &next;
    free(discarded->memory);
    if (status != CW_OK)
        return status;
    b->partial = b->partial || !all_go_on(b->nodes, from, config->node_count);
    b->memory = next.memory;
    b->bus = next.bus;
    b->nodes = next.nodes;
    b->triggering = next.triggering;
    return CW_OK;
}

void fuzz_bus_close(fuzz_bus *b)
{
    free(b->memory);
    b->memory = NULL;
    b->bus = NULL;
}

static void hash_event(fuzz_bus *b, const cw_event *e)
{
    const uint64_t values[] = {
        e->tick,
        e->nodes,
        e->kind,
        e->tec,
        e->rec,
        e->error.type,
        e->error.role,
        e->error.flag,
        e->error.place.field,
        e->error.place.index,
        e->error.place.stuff,
        e->error.place.extended,
        e->state,
        e->state_before,
        e->why,
        e->lost_bit,
        e->up,
        e->rule,
        e->hit,
        e->frame.id,
        e->frame.flags,
        e->frame.dlc,
    };
    for (size_t i = 0; i < sizeof values / sizeof values[0]; i++)
        b->hash = mix(b->hash, values[i]);
    for (unsigned i = 0; i < cw_frame_length(&e->frame); i++)
        b->hash = mix(b->hash, e->frame.data[i]);
}

static void check_event(const fuzz_bus *b, const cw_event *e)
{
    REQUIRE(e->kind < CW_EVENT_COUNT);
    REQUIRE(e->tick >= b->last_tick);
    REQUIRE(e->tick <= cw_bus_now(b->bus));
    REQUIRE((e->nodes == 0) == (e->kind == CW_EVENT_FAULT));
    REQUIRE(b->nodes == CW_NODES_MAX || e->nodes >> b->nodes == 0);
    REQUIRE(e->kind == CW_EVENT_RX || (e->nodes & (e->nodes - 1)) == 0);
    REQUIRE(e->tec <= TEC_MAX && e->rec <= REC_MAX);
    REQUIRE(e->kind != CW_EVENT_STATE || e->state != e->state_before);
    REQUIRE(e->kind != CW_EVENT_TX || cw_frame_valid(&e->frame));
}

static void write_event(const fuzz_bus *b, const cw_event *e)
{
    fprintf(stderr, "%c %" PRIu64 " %" PRIx64 " %s %u/%u rule %u hit %u id %" PRIx32 "\n", b->label,
            e->tick, e->nodes, cw_event_name(e->kind), e->tec, e->rec, e->rule, e->hit,
            e->frame.id);
}

void fuzz_bus_poll(fuzz_bus *b)
{
    while (cw_bus_poll(b->bus, &b->last)) {
        if (b->trace)
            write_event(b, &b->last);
        check_event(b, &b->last);
        b->last_tick = b->last.tick;
        b->events++;
        b->count[b->last.kind] +=
            b->last.nodes ? (unsigned)__builtin_popcountll(b->last.nodes) : 1u;
        hash_event(b, &b->last);
        if (b->take)
            b->take(b->user, &b->last);
    }
}

void fuzz_bus_advance(fuzz_bus *b, uint64_t tick)
{
    for (;;) {
        cw_status status = cw_bus_advance(b->bus, tick);
        uint64_t before = b->events;
        fuzz_bus_poll(b);
        if (status == CW_OK)
            break;
        REQUIRE(status == CW_FULL && b->events > before);
    }
    REQUIRE(tick < cw_bus_now(b->bus) || tick - cw_bus_now(b->bus) < b->bit_ticks);
}

void fuzz_bus_send(fuzz_bus *b, unsigned node, const cw_frame *frame, uint64_t tick)
{
    cw_status status = cw_node_send(b->bus, node, frame, tick);
    if (status == CW_FULL) {
        fuzz_bus_advance(b, cw_bus_inbox_first(b->bus) + b->bit_ticks);
        status = cw_node_send(b->bus, node, frame, tick);
    }
    REQUIRE(status == CW_OK);
}

typedef struct sums {
    uint64_t tx;
    uint64_t rx;
    uint64_t drops;
    uint64_t errors;
    uint64_t pending;
    uint64_t inbox;
} sums;

static void add_node(sums *s, const cw_node_stats *n)
{
    REQUIRE(n->tec <= TEC_MAX && n->rec <= REC_MAX);
    REQUIRE((n->state == CW_STATE_BUS_OFF) == (n->tec > 255));
    REQUIRE(cw_node_stats_balance(n));
    s->tx += n->tx_frames;
    s->rx += n->rx_frames;
    s->pending += n->queue + n->held + n->rx_held;
    s->inbox += n->inbox;
    for (unsigned i = 0; i < CW_DROP_COUNT; i++)
        s->drops += n->dropped[i] + n->rx_dropped[i];
    for (unsigned i = 0; i < CW_ERROR_COUNT; i++)
        s->errors += n->errors[i];
}

static void check_counts(const fuzz_bus *b, const sums *s, const cw_bus_stats *bus)
{
    if (bus->events_lost > 0 || b->partial)
        return;
    REQUIRE(b->count[CW_EVENT_TX] == s->tx);
    REQUIRE(b->count[CW_EVENT_RX] == s->rx);
    REQUIRE(b->count[CW_EVENT_DROP] + b->count[CW_EVENT_OVERRUN] == s->drops);
    REQUIRE(b->count[CW_EVENT_ERROR] == s->errors);
}

void fuzz_bus_check(const fuzz_bus *b)
{
    sums s = {.tx = 0};
    cw_bus_stats bus;
    cw_bus_get_stats(b->bus, &bus);
    for (unsigned i = 0; i < b->nodes; i++) {
        cw_node_stats node;
        REQUIRE(cw_node_get_stats(b->bus, i, &node) == CW_OK);
        add_node(&s, &node);
    }
    const uint64_t triggered = cw_bus_pending(b->bus) - s.pending - s.inbox; /* no host's frames */
    REQUIRE(s.pending == bus.pending && triggered <= b->triggering);
    REQUIRE(bus.busy_bits <= bus.bits && bus.load_permille <= 1000);
    check_counts(b, &s, &bus);
}

static cw_frame random_frame(uint64_t *state)
{
    static const uint32_t ids[] = {0x000, 0x123, 0x124, 0x1FF, 0x555, 0x7FF};
    uint32_t draw = fuzz_random(state);
    cw_frame frame = {.id = ids[draw % 6], .dlc = (uint8_t)(draw >> 8 & 15u)};
    if (draw >> 16 & 1u)
        frame = (cw_frame){
            .id = fuzz_random(state) & 0x1FFFFFFFu, .flags = CW_FRAME_EXTENDED, .dlc = frame.dlc};
    if ((draw >> 17 & 7u) == 0)
        frame.flags |= CW_FRAME_REMOTE;
    for (unsigned i = 0; i < cw_frame_length(&frame); i++)
        frame.data[i] = (uint8_t)(draw >> 20 & 1u ? fuzz_random(state) : 0);
    return frame;
}

void fuzz_bus_traffic(fuzz_bus *b, unsigned bits, uint64_t seed)
{
    uint64_t state = seed | 1;
    uint64_t end = cw_bus_now(b->bus) + (uint64_t)bits * b->bit_ticks;
    for (uint64_t tick = cw_bus_now(b->bus); tick < end;) {
        const cw_frame frame = random_frame(&state);
        fuzz_bus_send(b, fuzz_random(&state) % b->nodes, &frame, tick);
        tick += fuzz_random(&state) % (PAUSE_BITS * (uint64_t)b->bit_ticks);
    }
    fuzz_bus_advance(b, end);
    fuzz_bus_check(b);
}
