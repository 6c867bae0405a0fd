/* SPDX-License-Identifier: MIT
 *
 * action_raw.c - the action `raw`: frames with deviating bits, and bits that no controller drives.
 */
#include "config/parts.h"

#include "config/values.h"

#include <string.h>

#define WARNING_LIMIT 96u
#define BITS_EXPECTED "wire bits such as 0001011, 0 is dominant"

static schema_reader read_raw, read_deviation, read_bits, read_mac, read_start;

static const uint8_t srr = CW_DEVIATES_SRR, r1 = CW_DEVIATES_R1, r0 = CW_DEVIATES_R0;

#define MEMBER(m) .offset = offsetof(cw_rule, m)

static const schema_choice starts[] = {
    {.name = "idle", .value = true},
    {.name = "at-once", .value = false},
    {.name = NULL},
};

#define LEVEL "{'enum': ['dominant', 'recessive']}"

/* The keys of `raw: { ... }`. */
static const schema_key raw_part_keys[] = {
    {.name = "frame", .read = cfg_read_frame, MEMBER(frame),
     .help = "This frame, with the CRC and the stuff bits that belong to its bits."},
    {.name = "srr", .read = read_deviation, .arg = &srr, .type = LEVEL, .preset = "recessive",
     .help = "SRR of an extended frame."},
    {.name = "r1", .read = read_deviation, .arg = &r1, .type = LEVEL, .preset = "dominant",
     .help = "r1 of an extended frame; FDF to CAN FD."},
    {.name = "r0", .read = read_deviation, .arg = &r0, .type = LEVEL, .preset = "dominant",
     .help = "r0; FDF of a base frame to CAN FD."},
    {.name = "bits", .read = read_bits, .type = "rawBits",
     .help = "Instead of a frame, as `canwire bits --raw` prints them. Blanks are left out."},
    {.name = NULL,
     .type = "{'oneOf': [" TYPE_NEEDS("frame") ", " TYPE_NEEDS("bits") "]}"},
};

const schema_key cfg_raw_keys[] = {
    {.name = "raw", .read = read_raw, .map = raw_part_keys,
     .type = TYPE_ANY(TYPE_REF("frame") ", " TYPE_REF("rawBits") ", @"),
     .help = "What the node drives: a classical frame, maybe with deviating bits, or wire bits; 0 "
             "is dominant."},
    {.name = "as", .read = cfg_read_node_index, MEMBER(node), .required = true,
     .help = "The node that drives it."},
    {.name = "mac", .read = read_mac, .type = "boolean",
     .help = "With or without its controller. On: that sends it as a frame of its own. Off: the "
             "node drives the bits, whatever it samples. Default: on for a frame, off for bits."},
    {.name = "start", .read = read_start, .type = TYPE_CHOICE, .arg = starts, .preset = "idle",
     .help = "With `mac: off`: when the bits begin."},
    {.name = NULL},
};

/* ---- Values ---------------------------------------------------------------------------------- */

/* SRR is recessive, the reserved bits are dominant (F2). */
static void read_deviation(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_rule *rule = object;
    const uint8_t deviation = *(const uint8_t *)key->arg;
    const bool usual = deviation == CW_DEVIATES_SRR ? CW_RECESSIVE : CW_DOMINANT;
    unsigned level;

    if (schema_choose(self, &level, key, value, cfg_levels) && (level != 0) != usual)
        rule->deviations |= deviation;
}

/* Reads raw bits, 0 dominant and 1 recessive. Blanks are for people. */
static void read_bits(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_rule *rule = object;
    const char *text = schema_text(self, key, value, BITS_EXPECTED);
    unsigned count = 0;

    for (; text && *text; text++) {
        if (*text == ' ')
            continue;
        if (*text != '0' && *text != '1') {
            schema_expected(self, key, value, BITS_EXPECTED);
            return;
        }
        if (count == CW_RAW_MAX) {
            schema_complain(self, value, "%s: more than %d bits", key->name, CW_RAW_MAX);
            return;
        }
        if (*text == '1')
            rule->raw[count / 64] |= UINT64_C(1) << (count % 64);
        count++;
    }
    rule->bits = (uint16_t)count;
}

/* Reads a map; or in short a frame, or bits. */
static void read_raw(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const char *text = value->type == YAML_SCALAR_NODE
                           ? (const char *)value->data.scalar.value : NULL;
    const schema_key frame = {.name = key->name, .read = cfg_read_frame, MEMBER(frame)};

    ((cw_rule *)object)->bits = 0;
    if (text && strchr(text, '#'))
        cfg_read_frame(self, &frame, value, object);
    else if (text)
        read_bits(self, key, value, object);
    else
        schema_map(self, key->name, value, raw_part_keys, object);
}

/* Only checks the value: its default depends on keys that may follow. */
static void read_mac(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    bool on;

    (void)object;
    (void)schema_choose_bool(self, &on, key, value); /* cfg_complete_raw() takes it */
}

/* Bits begin when the bus is idle, or at once in the middle of anything. */
static void read_start(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    unsigned idle;

    if (schema_choose(self, &idle, key, value, starts))
        ((cw_rule *)object)->raw_when_idle = idle;
}

/* ---- Bits and frames ------------------------------------------------------------------------- */

/* Returns true when the rule has just these bits, from SOF on. */
static bool same_bits(const cw_rule *rule, const cw_bits *bits)
{
    if (bits->length != rule->bits)
        return false;
    for (unsigned n = 0; n < bits->length; n++)
        if (cw_bits_level(bits, n) != (rule->raw[n / 64] >> (n % 64) & 1u))
            return false;
    return true;
}

static void put_bits(cw_rule *rule, const cw_bits *bits)
{
    rule->bits = bits->length;
    memcpy(rule->raw, bits->level, sizeof rule->raw);
}

/* Lets a controller receive the bits. Returns the bit in which it finds an error, or before which
 * the frame ends. Returns the last bit if the frame does not end with it, and else the number of
 * bits. */
static unsigned action_raw_receive(cw_mac *mac, const cw_rule *rule)
{
    cw_mac_report report = {.what = 0};
    unsigned n = 0;

    cw_mac_init(mac, 0, WARNING_LIMIT);
    while (cw_mac_get_phase(mac) != CW_MAC_IDLE)
        cw_mac_sample(mac, CW_RECESSIVE, &report);
    for (; n < rule->bits && cw_mac_get_phase(mac) != CW_MAC_INTERMISSION; n++) {
        const bool own = cw_mac_drive(mac);
        cw_mac_sample(mac, own && (rule->raw[n / 64] >> (n % 64) & 1u), &report);
        if (report.what & (CW_REPORT_ERROR | CW_REPORT_OVERLOAD))
            return n;
    }
    return cw_mac_get_phase(mac) == CW_MAC_INTERMISSION ? n : rule->bits - 1u;
}

/* Finds the frame of the bits, and how it deviates. */
static bool find_frame(cw_rule *rule, unsigned *wrong)
{
    cw_mac mac;
    cw_bits bits;
    const unsigned n = action_raw_receive(&mac, rule);

    rule->frame = (cw_frame){0};
    memcpy(&rule->frame, cw_mac_received(&mac), sizeof(cw_short_frame));
    *wrong = n < rule->bits ? n : 0;
    for (unsigned deviations = 0; n == rule->bits && deviations < 8; deviations++)
        if (cw_bits_encode_deviant(&bits, &rule->frame, deviations) == CW_OK &&
            same_bits(rule, &bits)) {
            rule->deviations = (uint8_t)deviations;
            return true;
        }
    return false;
}

/* ---- Keys against each other ----------------------------------------------------------------- */

/* Returns the value of `mac`, or the usual one when the map has no such key. */
static bool mac_is_on(schema *self, const yaml_node_t *map, bool usual)
{
    static const schema_key key = {.name = "mac"};
    yaml_node_t *const value = schema_find(self, map, key.name);

    if (value)
        (void)schema_choose_bool(self, &usual, &key, value);
    return usual;
}

/* Checks the bits that deviate against the frame. */
static bool can_deviate(schema *self, const yaml_node_t *at, const cw_rule *rule)
{
    cw_bits bits;
    const bool fits = cw_bits_encode_deviant(&bits, &rule->frame, rule->deviations) == CW_OK;

    if (!fits && (rule->frame.flags & CW_FRAME_FD))
        schema_complain(self, at, "raw: frames of CAN FD do not deviate");
    else if (!fits)
        schema_complain(self, at, "raw: a base frame has neither srr nor r1");
    return fits;
}

/* A node with the bit FDF would take its own frame for one of CAN FD. */
static void check_reserved(schema *self, const yaml_node_t *at, const cw_rule *rule)
{
    const cfg *config = cfg_of(self);
    const cfg_walk *walk = self->user;
    const bool extended = rule->frame.flags & CW_FRAME_EXTENDED;
    const unsigned fdf = extended ? CW_DEVIATES_R1 : CW_DEVIATES_R0;

    if (walk->any_node || rule->node >= config->node_count || !(rule->deviations & fdf))
        return;
    const cfg_node *node = &config->nodes[rule->node];
    if (cfg_knows_fd(config, node) || node->kind == CFG_KIND_FD_TOLERANT)
        schema_complain(self, at, "raw: to the controller of '%s' a recessive %s is FDF, so it "
                        "cannot send this frame (mac: off, or kind: classical)", node->name,
                        extended ? "r1" : "r0");
}

/* Makes an action of `mac: on`: the controller sends the frame, with its deviations, when it
 * may. */
static void complete_frame(schema *self, const yaml_node_t *map, cw_rule *rule)
{
    const yaml_node_t *const raw = schema_find(self, map, "raw");
    const bool in_map = raw->type == YAML_MAPPING_NODE && rule->bits == 0;
    const schema_key key = {.name = in_map ? "frame" : "raw"};
    const yaml_node_t *const value = in_map ? schema_find(self, raw, key.name) : raw;
    unsigned wrong = 0;

    if (rule->bits && !find_frame(rule, &wrong)) {
        schema_complain(self, value, "raw: with 'mac: on' the bits must be those of a frame, SOF "
                        "to EOF with a recessive ACK slot; bit %u is not", wrong);
        return;
    }
    if (!can_deviate(self, value, rule))
        return;
    if (schema_find(self, map, "start"))
        schema_complain(self, schema_find(self, map, "start"),
                        "start: with 'mac: on' the controller starts when it may");
    check_reserved(self, value, rule);
    cfg_check_sender(self, &key, value, &rule->frame, rule->node);
    rule->action = CW_ACTION_RAW_FRAME;
}

/* Makes the bits of a frame with its deviations, which the node then drives without its
 * controller. */
static void complete_bits(schema *self, const yaml_node_t *map, cw_rule *rule)
{
    cw_bits bits;

    if (rule->bits || !can_deviate(self, schema_find(self, map, "raw"), rule))
        return;
    (void)cw_bits_encode_deviant(&bits, &rule->frame, rule->deviations);
    put_bits(rule, &bits);
}

/* Returns false when the value says neither a frame nor bits, or both. */
static bool says_one(schema *self, const yaml_node_t *value, const cw_rule *rule)
{
    const bool map = value->type == YAML_MAPPING_NODE;
    const bool frame = map ? schema_find(self, value, "frame") != NULL : rule->bits == 0;
    const bool bits = map ? schema_find(self, value, "bits") != NULL : rule->bits > 0;
    const char *const text = map ? "" : (const char *)value->data.scalar.value;

    if (frame == bits || (!map && *text == '\0'))
        schema_complain(self, value, "raw: one of the keys 'frame' and 'bits' is needed");
    else if (bits && rule->bits == 0)
        schema_complain(self, value, "raw: expected " BITS_EXPECTED);
    else if (bits && rule->deviations)
        schema_complain(self, value, "raw: bits are as they are given; srr, r1 and r0 belong to "
                        "a frame");
    else
        return true;
    return false;
}

void cfg_complete_raw(schema *self, yaml_node_t *map, cw_rule *rule)
{
    const yaml_node_t *const value = schema_find(self, map, "raw");

    if (self->has_open || !says_one(self, value, rule))
        return;
    if (mac_is_on(self, map, rule->bits == 0))
        complete_frame(self, map, rule);
    else
        complete_bits(self, map, rule);
}
