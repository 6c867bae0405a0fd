/* SPDX-License-Identifier: MIT
 *
 * hosts.c - the frames that the program hands in, and those that it gets.
 */
#include "embed/embed.h"

#include "base/text/number.h"
#include "record/output.h"

#include <linux/can.h>
#include <stdlib.h>
#include <string.h>

#define FRAMES_FIRST 64u /* room of a node that begins to listen */

/* ---- To the bus ------------------------------------------------------------------------------ */

/* Turns a frame into one of the bus. Returns NULL, or says what is wrong with it. */
static const char *to_bus(cw_frame *out, const canwire_sim_frame *in)
{
    const bool fd = in->flags & CANWIRE_SIM_FRAME_FD;
    const bool extended = in->can_id & CAN_EFF_FLAG;
    const bool remote = in->can_id & CAN_RTR_FLAG;
    const uint32_t id = in->can_id & CAN_EFF_MASK;
    if (in->can_id & CAN_ERR_FLAG)
        return "error frames are only received";
    if (!extended && id > CAN_SFF_MASK)
        return "a base identifier is at most 7FF";
    if (fd && remote)
        return "there are no remote frames with CAN FD";
    if (in->length > (fd ? CW_FRAME_DATA_MAX : CW_CLASSICAL_DATA_MAX))
        return fd ? "a CAN FD frame has at most 64 bytes" : "a classical frame has at most 8 bytes";
    if (in->raw_dlc && (fd || in->length != 8 || in->raw_dlc < 9 || in->raw_dlc > 15))
        return "a raw DLC is 9 to 15, of a classical frame with length 8";
    *out = (cw_frame){.id = id, .dlc = in->raw_dlc ? in->raw_dlc : in->length};
    out->flags = (uint8_t)((extended ? CW_FRAME_EXTENDED : 0) | (remote ? CW_FRAME_REMOTE : 0));
    if (fd) {
        out->flags |= CW_FRAME_FD;
        out->flags |= in->flags & CANWIRE_SIM_FRAME_BRS ? CW_FRAME_BRS : 0;
        out->dlc = (uint8_t)cw_fd_dlc(in->length);
    }
    memcpy(out->data, in->data, in->length);
    return NULL;
}

int canwire_sim_send(canwire_sim *sim, int node, const canwire_sim_frame *frame, int64_t at)
{
    unsigned number;
    cw_frame sent;
    embed_bus *b = embed_find_node(sim, &number, node);
    if (!b)
        return CANWIRE_SIM_INVALID;
    const char *wrong = to_bus(&sent, frame);
    if (wrong)
        return embed_fail(sim, CANWIRE_SIM_INVALID, "%s", wrong);
    const uint64_t tick = embed_tick_at(at);
    if (inputs_send(&b->in, number, &sent, tick > sim->reached ? tick : sim->reached) != CW_FULL)
        return CANWIRE_SIM_OK;
    return embed_fail(sim, CANWIRE_SIM_REFUSED, "too many frames wait for a later time");
}

int canwire_sim_room(const canwire_sim *sim, int node)
{
    const int bus = canwire_sim_bus_of_node(sim, node);
    if (bus < 0)
        return CANWIRE_SIM_INVALID;
    const embed_bus *b = &sim->buses[bus];
    return (int)cw_node_room(b->run.bus, (unsigned)(node - b->first_node));
}

/* ---- From the bus ---------------------------------------------------------------------------- */

void embed_frame_from(canwire_sim_frame *out, const cw_frame *in)
{
    const unsigned length = cw_frame_length(in);
    const bool fd = in->flags & CW_FRAME_FD;
    const bool remote = in->flags & CW_FRAME_REMOTE;
    *out = (canwire_sim_frame){.can_id = in->id};
    out->can_id |= in->flags & CW_FRAME_EXTENDED ? CAN_EFF_FLAG : 0;
    out->can_id |= remote ? CAN_RTR_FLAG : 0;
    out->length = (uint8_t)(remote ? (in->dlc < 8 ? in->dlc : 8) : length);
    out->raw_dlc = !fd && in->dlc > 8 ? in->dlc : 0;
    if (fd)
        out->flags = (uint8_t)(CANWIRE_SIM_FRAME_FD |
                               (in->flags & CW_FRAME_BRS ? CANWIRE_SIM_FRAME_BRS : 0) |
                               (in->flags & CW_FRAME_ESI ? CANWIRE_SIM_FRAME_ESI : 0));
    memcpy(out->data, in->data, length);
}

/* Makes room for one frame more. Returns false without memory. */
static bool hosts_grow(embed_node *n)
{
    const size_t room = n->room ? 2 * n->room : FRAMES_FIRST;
    embed_frame *frames = malloc(room * sizeof *frames);
    if (!frames)
        return false;
    for (size_t i = 0; i < n->count; i++)
        frames[i] = n->frames[(n->first + i) % n->room];
    free(n->frames);
    n->frames = frames;
    n->first = 0;
    n->room = room;
    return true;
}

/* Keeps a frame for a host. */
static void keep_frame(embed_bus *b, unsigned node, const canwire_sim_frame *frame, uint64_t tick)
{
    embed_node *n = &b->nodes[node];
    if (n->count == n->room && !hosts_grow(n)) {
        b->sim->no_memory = true;
        return;
    }
    embed_frame *kept = &n->frames[(n->first + n->count++) % n->room];
    kept->tick = tick;
    kept->frame = *frame;
    kept->frame.t = (int64_t)text_ticks_ns(tick);
    if (embed_is_meant(b, node, b->sim->frame_at))
        sim_pause(&b->run);
}

/* Keeps the error frame that the driver of a node makes of an event, if it makes one and its limit
 * lets that pass. */
static void keep_error(embed_bus *b, unsigned node, const cw_event *event)
{
    errframe error;
    cw_settings settings;
    const errframe_driver driver = b->config->nodes[node].controller.driver;
    if (cw_node_get_settings(b->run.bus, node, &settings) != CW_OK ||
        !errframe_from_event(&error, event, settings.modes, driver) ||
        !errframe_limit_pass(&b->nodes[node].limit, &error, event->tick))
        return;
    canwire_sim_frame frame = {.can_id = error.can_id, .length = sizeof error.data};
    memcpy(frame.data, error.data, sizeof error.data);
    keep_frame(b, node, &frame, event->tick);
}

/* Gives an event to the host of a node. */
static void hosts_deliver(embed_bus *b, unsigned node, const cw_event *event)
{
    const unsigned listens = b->nodes[node].listens;
    const bool own = event->kind == CW_EVENT_TX;
    if (event->kind != CW_EVENT_RX && !own) {
        if (listens & CANWIRE_SIM_LISTEN_ERRORS)
            keep_error(b, node, event);
        return;
    }
    if (!(listens & (own ? CANWIRE_SIM_LISTEN_OWN : CANWIRE_SIM_LISTEN_RX)))
        return;
    canwire_sim_frame frame;
    embed_frame_from(&frame, &event->frame);
    frame.flags |= own ? CANWIRE_SIM_FRAME_OWN : 0;
    keep_frame(b, node, &frame, event->tick);
}

int canwire_sim_listen(canwire_sim *sim, int node, int what)
{
    unsigned number;
    embed_bus *b = embed_find_node(sim, &number, node);
    if (!b)
        return CANWIRE_SIM_INVALID;
    b->nodes[number].listens = (unsigned)what;
    embed_choose_events(b);
    return CANWIRE_SIM_OK;
}

int canwire_sim_receive(canwire_sim *sim, int node, canwire_sim_frame *out)
{
    unsigned number;
    embed_bus *b = embed_find_node(sim, &number, node);
    if (!b)
        return CANWIRE_SIM_INVALID;
    embed_node *n = &b->nodes[number];
    if (n->count == 0 || n->frames[n->first].tick > sim->reached)
        return 0;
    *out = n->frames[n->first].frame;
    n->first = (n->first + 1) % n->room;
    n->count--;
    return 1;
}

/* ---- Events ---------------------------------------------------------------------------------- */

void embed_event(void *user, const cw_event *event)
{
    embed_bus *b = user;
    canwire_sim *sim = b->sim;
    const bool kept = sim->kinds >> event->kind & 1u;
    if (event->kind == CW_EVENT_RX || event->kind == CW_EVENT_DROP)
        sim_group_note(&sim->group, b->index, event);
    losses_event(&b->lost, event);
    for (const embed_judge *j = b->judges; j; j = j->next)
        expect_event(j->judge, event);
    if (kept)
        embed_keep(b, event);
    if ((kept && sim->awaits_any) || (b->awaited.text && sim_until_is(&b->awaited, event))) {
        sim->happened = true;
        sim_pause(&b->run);
    }
    for (uint64_t rest = event->nodes; rest; rest &= rest - 1) {
        const unsigned node = (unsigned)__builtin_ctzll(rest);
        if (b->nodes[node].listens)
            hosts_deliver(b, node, event);
    }
}

void embed_choose_events(embed_bus *b)
{
    uint32_t kinds = b->sim->kinds | b->awaited.kinds | 1u << CW_EVENT_TX | LOSSES_KINDS;
    bool listens = false;
    for (size_t i = 0; i < b->config->node_count; i++)
        listens = listens || b->nodes[i].listens;
    if (b->judges || listens)
        kinds |= CW_EVENTS_USUAL;
    if (sim_group_wants(&b->sim->group, b->index))
        kinds |= 1u << CW_EVENT_RX;
    sim_set_kinds(&b->run, 0, kinds);
}
