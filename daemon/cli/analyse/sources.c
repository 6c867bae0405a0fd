/* SPDX-License-Identifier: MIT
 *
 * sources.c - the periodic messages of a configuration, with the lengths of their frames.
 */
#include "cli/analyse/sources.h"

#include "cli/analyse/lengths.h"
#include "cli/analyse/slots.h"

#include <stdlib.h>
#include <string.h>

#define OVERLOADS 34u /* bits of two overload frames: flag, delayed flag of others, delimiter */
#define MEAN_OF 128u /* frames with random data */

/* ---- Lengths --------------------------------------------------------------------------------- */

/* Returns the time of a frame as it is. */
static uint64_t time_as_configured(const cfg *config, const cw_frame *frame)
{
    cw_bits bits;
    unsigned fast = 0;
    if (cw_bits_encode(&bits, frame) != CW_OK)
        return 0;
    for (unsigned n = 0; n < bits.length; n++)
        fast += cw_bits_is_fast(&bits, n);
    return lengths_time(config, bits.length + LENGTHS_INTERMISSION_BITS, fast);
}

/* Returns the same for random data. */
static uint64_t mean_time(const cfg *config, const cw_frame *frame)
{
    cw_frame random = *frame;
    uint64_t sum = 0, draw = 0;
    for (unsigned n = 0; n < MEAN_OF; n++) {
        for (unsigned k = 0; k < cw_frame_length(frame); k++)
            random.data[k] = (uint8_t)(cw_random(1, "data", draw++) >> 32);
        sum += time_as_configured(config, &random);
    }
    return sum / MEAN_OF;
}

/* ---- Controllers ----------------------------------------------------------------------------- */

/* Returns true when all these mailboxes may have frames of messages other than `me`, one each. */
static bool may_be_full(const cfg_node *node, const uint64_t *used, size_t me, uint64_t boxes)
{
    uint64_t taken = 0;
    unsigned others = 0;
    for (size_t t = 0; t < node->traffic_count; t++) {
        if (t == me || !(used[t] & boxes))
            continue;
        taken |= used[t];
        others++;
    }
    return !(boxes & ~taken) && others >= (unsigned)__builtin_popcountll(boxes);
}

/* Adds the mailboxes that frames of a message may come into. They take the first free one. Returns
 * true when they may find none. */
static bool use_boxes(const cfg_node *node, uint64_t *used, size_t me)
{
    const cfg_controller *c = &node->controller;
    uint64_t before = 0;
    for (unsigned b = 0; b < c->mailbox_count; b++) {
        if (c->mailboxes[b].use != CW_MAILBOX_TRANSMIT ||
            !cw_frame_matches(&node->traffic[me].frame, &c->mailboxes[b].filter, 1))
            continue;
        if (!may_be_full(node, used, me, before))
            return false;
        used[me] |= UINT64_C(1) << b;
        before |= UINT64_C(1) << b;
    }
    return may_be_full(node, used, me, before);
}

/* Finds the mailboxes of all messages anew until there are no more. Returns true when each finds a
 * free one at any time. */
static bool find_boxes(const cfg_node *node, uint64_t *used)
{
    bool waits = false, changed = true;
    while (changed && !waits) {
        changed = false;
        for (size_t t = 0; t < node->traffic_count; t++) {
            const uint64_t before = used[t];
            waits = use_boxes(node, used, t) || waits;
            changed = changed || used[t] != before;
        }
    }
    return !waits;
}

/* Returns true when each message of a node finds a free transmit mailbox, so that none waits behind
 * others. Each has one frame at a time. Frames of triggers would take mailboxes, too. */
static bool has_boxes_for_all(const cfg_node *node)
{
    bool sends = node->schedule.trigger_count == 0;
    for (size_t t = 0; t < node->traffic_count; t++)
        sends = sends && node->traffic[t].kind == CFG_TRAFFIC_SEND;
    uint64_t *used = sends ? calloc(node->traffic_count + 1, sizeof *used) : NULL;
    const bool found = used && find_boxes(node, used);
    free(used);
    return found;
}

/* Returns true when the most urgent frame of a node with mailboxes always goes next. */
static bool is_boxed(const cfg_node *node)
{
    return node->controller.mailbox_count > 0 &&
           node->controller.transmit == CW_TRANSMIT_PRIORITY && has_boxes_for_all(node);
}

/* Returns true when frames of a node may wait for others of the node with higher identifiers. With
 * mailboxes the order of the queue is that of frames that find none. */
static bool has_inner_inversion(const cfg_node *node)
{
    return node->controller.mailbox_count > 0 ? !is_boxed(node) : node->order == CW_ORDER_FIFO;
}

/* Returns true when a controller keeps a frame for its replies, and does not send it. */
static bool is_stored(const cfg_node *node, const cw_frame *frame)
{
    const cfg_controller *c = &node->controller;
    for (unsigned b = 0; b < c->mailbox_count && !(frame->flags & CW_FRAME_REMOTE); b++)
        if (c->mailboxes[b].use == CW_MAILBOX_REPLY &&
            cw_frame_matches(frame, &c->mailboxes[b].filter, 1))
            return true;
    return false;
}

/* Replies come when somebody asks for them, so their times are not known. */
static bool has_replies(const cfg_node *node)
{
    for (unsigned b = 0; b < node->controller.mailbox_count; b++)
        if (node->controller.mailboxes[b].use == CW_MAILBOX_REPLY)
            return true;
    return false;
}

/* Returns how much longer than nominal the bits of the slowest node are, in 2^-32. */
static uint64_t slowness(const cfg *config)
{
    const uint64_t nominal = cw_rate_ticks(config->rate, 1) << 32;
    uint64_t longest = nominal;
    for (size_t i = 0; i < config->node_count; i++) {
        const cw_bit_timing *bit = &config->nodes[i].time.timing.bit;
        const uint64_t length = (uint64_t)bit->quantum * cw_bit_timing_quanta(bit);
        longest = bit->quantum && length > longest ? length : longest;
    }
    return (longest - nominal) / (nominal >> 32) + (longest > nominal);
}

/* Returns the longest time that a frame occupies the bus. The slowest clock counts, with a bit for
 * the differences of clocks, and so do overload frames that full buffers ask for. */
static uint64_t longest_time(const sources *s, uint64_t ticks)
{
    const unsigned bits = (s->overloads ? OVERLOADS : 0) + (s->slowness > 0);
    return ticks + (s->slowness * ticks >> 32) + cw_rate_ticks(s->config->rate, bits);
}

/* ---- Messages -------------------------------------------------------------------------------- */

/* Adds a message of a node. Its times are for the caller to fill in. */
static void sources_add(sources *s, source **source_of, response_message **message_of,
                        unsigned index, const cw_frame *sent)
{
    const cfg *config = s->config;
    const cfg_node *node = &config->nodes[index];
    cw_frame frame = *sent;
    unsigned fast;
    if ((frame.flags & CW_FRAME_FD) && config->fd_non_iso)
        frame.flags |= CW_FRAME_NON_ISO;
    source *new = *source_of = &s->list[s->count];
    *new = (source){.node = node, .frame = sent, .every = CW_NEVER,
                    .bits = lengths_longest_bits(&frame, &fast),
                    .length = time_as_configured(config, &frame),
                    .mean = mean_time(config, &frame),
                    .id_stuff = cw_frame_id_stuff_bits(&frame)};
    *message_of = &s->messages[s->count++];
    **message_of = (response_message){
        .key = response_key(&frame),
        .node = index,
        .fifo = has_inner_inversion(node),
        .boxed = is_boxed(node),
        .period = CW_NEVER,
        .length = longest_time(s, lengths_time(config, new->bits, fast)),
    };
}

/* Adds an entry of traffic as a message. Of replays nothing is known beforehand: the analysis is
 * incomplete. */
static void add_traffic(sources *s, unsigned index, const cfg_traffic *traffic)
{
    const cw_rate rate = s->config->rate;
    source *new;
    response_message *message;
    if (traffic->kind != CFG_TRAFFIC_SEND) {
        s->incomplete = true;
        return;
    }
    if (is_stored(&s->config->nodes[index], &traffic->frame))
        return;
    sources_add(s, &new, &message, index, &traffic->frame);
    new->traffic = traffic;
    if (traffic->has_every)
        new->every = message->period = text_time_ticks(traffic->every, rate);
    message->jitter = text_time_ticks(traffic->jitter, rate);
}

/* Adds a trigger of a schedule. Without a known cadence it is counted as a stranger, whose time
 * nobody knows. */
static void add_trigger(sources *s, const slots *in, unsigned index, unsigned k)
{
    const cfg_schedule *schedule = &s->config->nodes[index].schedule;
    const cw_frame *frame = &schedule->triggers[k].frame;
    const slots_cadence *cadence = slots_of(in, index, k);
    source *new;
    response_message *message;
    if (is_stored(&s->config->nodes[index], frame))
        return;
    if (!cadence) {
        s->strangers = true;
        return;
    }
    sources_add(s, &new, &message, index, frame);
    new->trigger = k + 1;
    new->arbitrating = schedule->arbitrating[k];
    new->every = cadence->usual;
    message->period = cadence->period;
    message->jitter = cadence->jitter;
    message->slot = cadence->slot;
}

/* Adds the messages of a node, and notes what is unknown of it. */
static void sources_add_node(sources *s, const slots *in, unsigned index)
{
    const cfg_node *node = &s->config->nodes[index];
    s->incomplete = s->incomplete || node->port || has_replies(node);
    s->sleepers = s->sleepers || node->sleeps;
    for (size_t t = 0; t < node->traffic_count; t++)
        add_traffic(s, index, &node->traffic[t]);
    for (unsigned k = 0; k < node->schedule.trigger_count; k++)
        add_trigger(s, in, index, k);
}

/* Sorts by priority, in both lists. */
static void sort(sources *s)
{
    for (size_t i = 1; i < s->count; i++) {
        const source moved = s->list[i];
        const response_message message = s->messages[i];
        size_t place = i;
        for (; place > 0 && s->messages[place - 1].key > message.key; place--) {
            s->list[place] = s->list[place - 1];
            s->messages[place] = s->messages[place - 1];
        }
        s->list[place] = moved;
        s->messages[place] = message;
    }
}

bool sources_find(sources *s, const cfg *config)
{
    size_t most = 1;
    for (size_t i = 0; i < config->node_count; i++)
        most += config->nodes[i].traffic_count + config->nodes[i].schedule.trigger_count;
    *s = (sources){.config = config, .list = calloc(most, sizeof *s->list),
                   .messages = calloc(most, sizeof *s->messages)};
    if (!s->list || !s->messages)
        return false;
    s->slowness = slowness(config);
    for (unsigned i = 0; i < config->node_count; i++)
        s->overloads = s->overloads || config->nodes[i].controller.overload_when_full;
    slots in;
    const bool found = slots_find(&in, config);
    for (unsigned i = 0; found && i < config->node_count; i++)
        sources_add_node(s, &in, i);
    slots_free(&in);
    sort(s);
    return found;
}

void sources_free(sources *s)
{
    free(s->list);
    free(s->messages);
    *s = (sources){.count = 0};
}
