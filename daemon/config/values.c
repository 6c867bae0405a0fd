/* SPDX-License-Identifier: MIT
 *
 * values.c - reads single values: names, times, fractions, frames, nodes, states.
 */
#include "config/values.h"

#include "base/text/counted.h"
#include "base/text/nearest.h"

#include <inttypes.h>
#include <string.h>

#define STATES_MAX ((size_t)CW_STATE_COUNT)

const schema_choice cfg_orders[] = {
    {.name = "priority", .value = CW_ORDER_PRIORITY},
    {.name = "fifo", .value = CW_ORDER_FIFO},
    {.name = NULL},
};

const schema_choice cfg_missing_ports[] = {
    {.name = "fail", .value = CFG_MISSING_PORT_FAIL},
    {.name = "wait", .value = CFG_MISSING_PORT_WAIT},
    {.name = NULL},
};

/* ---- Names and times ------------------------------------------------------------------------- */

/* The letters are good in paths, LCM channels and JSON without any quoting. */
bool cfg_name_valid(const char *name, size_t length_max)
{
    static const char allowed[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz"
                                  "0123456789_.-";
    size_t length = strlen(name);

    return length > 0 && length <= length_max && strspn(name, allowed) == length;
}

char *cfg_read_name(schema *self, const schema_key *key, const yaml_node_t *value,
                    size_t length_max)
{
    char expected[80];

    snprintf(expected, sizeof expected, "a name of 1 to %zu letters, digits, '_', '.' or '-'",
             length_max);
    const char *text = schema_text(self, key, value, expected);
    if (!text)
        return NULL;
    if (!cfg_name_valid(text, length_max))
        schema_expected(self, key, value, expected);
    return schema_copy(self, text);
}

void cfg_read_time(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const char *text = schema_text(self, key, value, "a time such as 10ms");

    if (text)
        schema_problem(self, key, value, text_parse_time(schema_member(key, object), text));
}

void cfg_read_span(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_time *time = schema_member(key, object);
    size_t errors = self->errors->errors;

    cfg_read_time(self, key, value, object);
    if (self->errors->errors == errors && time->ns == 0 && time->bits == 0)
        schema_complain(self, value, "%s: the time must be more than 0", key->name);
}

void cfg_read_ticks(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    uint64_t *ticks = schema_member(key, object);
    cfg_time time = {0};
    const char *text = schema_text(self, key, value, "a time such as 10ms");

    if (text)
        schema_problem(self, key, value, text_parse_time(&time, text));
    *ticks = text_time_ticks(time, cfg_of(self)->rate);
}

void cfg_read_ticks_min(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const uint64_t *ticks = schema_member(key, object);
    size_t errors = self->errors->errors;

    cfg_read_ticks(self, key, value, object);
    if (self->errors->errors == errors && *ticks == 0)
        schema_complain(self, value, "%s: the time must be more than 0", key->name);
}

void cfg_warn_rounded(schema *self, const schema_key *key, const yaml_node_t *value,
                      uint64_t ticks)
{
    const cfg_walk *walk = self->user;
    const cw_rate rate = walk->config->rate;
    const uint64_t bits = cw_rate_bits_begun(rate, ticks);
    char bit[TIME_TEXT_MAX];
    char whole[TIME_TEXT_MAX];

    /* A profile alone has no bit rate and gets no warning. */
    if (bits == cw_rate_bits(rate, ticks) || ticks == CW_NEVER || walk->any_node)
        return;
    text_print_span(bit, cw_rate_ticks(rate, 1));
    text_print_span(whole, cw_rate_ticks(rate, bits));
    schema_warn(self, value,
                "%s: no whole number of bits of %s, at which it acts: it is rounded up to %s, %s",
                key->name, bit, counted(bits, "bit").text, whole);
}

void cfg_read_bits(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const uint64_t *ticks = schema_member(key, object);

    cfg_read_ticks(self, key, value, object);
    cfg_warn_rounded(self, key, value, *ticks);
}

void cfg_read_bits_min(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const uint64_t *ticks = schema_member(key, object);

    cfg_read_ticks_min(self, key, value, object);
    cfg_warn_rounded(self, key, value, *ticks);
}

void cfg_read_period(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const uint64_t *ticks = schema_member(key, object);

    cfg_read_ticks_min(self, key, value, object);
    if (cw_rate_bits(cfg_of(self)->rate, *ticks) == 0)
        cfg_warn_rounded(self, key, value, *ticks);
}

void cfg_read_fine(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_span *span = schema_member(key, object);
    cfg_time time = {0};
    const char *text = schema_text(self, key, value, "a time such as 90ns");

    if (text)
        schema_problem(self, key, value, text_parse_time(&time, text));
    *span = text_time_fine(time, cfg_of(self)->rate);
}

void cfg_read_fine_min(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cw_span *span = schema_member(key, object);
    const size_t errors = self->errors->errors;

    cfg_read_fine(self, key, value, object);
    if (self->errors->errors == errors && *span == 0)
        schema_complain(self, value, "%s: the time must be more than 0", key->name);
}

const schema_choice cfg_levels[] = {
    {.name = "dominant", .value = CW_DOMINANT},
    {.name = "recessive", .value = CW_RECESSIVE},
    {.name = NULL},
};

void cfg_read_level(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_rule *rule = object;
    unsigned level;

    if (schema_choose(self, &level, key, value, cfg_levels))
        rule->level = level;
}

void cfg_read_fraction(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const char *text = schema_text(self, key, value, "a decimal fraction from 0 to 1");

    if (text)
        schema_problem(self, key, value, text_parse_probability(schema_member(key, object), text));
}

/* Reads a number of bits up to CW_BURST_MAX. Returns what follows it, or NULL. */
static const char *read_bits_of_burst(uint16_t *out, const char *text)
{
    uint64_t bits = 0;
    const bool good = text_take_uint(&bits, &text, CW_BURST_MAX) && bits > 0;
    *out = (uint16_t)bits;
    return good ? text : NULL;
}

void cfg_read_burst(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_rule *rule = object;
    const char *text = schema_text(self, key, value, "a number of bits, or LEAST..MOST");
    if (!text)
        return;
    const char *end = read_bits_of_burst(&rule->burst_least, text);
    rule->burst_most = rule->burst_least;
    if (end && strncmp(end, "..", 2) == 0)
        end = read_bits_of_burst(&rule->burst_most, end + 2);
    if (!end || *end || rule->burst_most < rule->burst_least)
        schema_problem(self, key, value, "expected a number of bits from 1 to 16, or LEAST..MOST "
                                         "of these, such as 1..15");
}

/* ---- Frames ---------------------------------------------------------------------------------- */

#define MAKES_FD "(kind: fd of a node, or a dbitrate of the bus, makes it a CAN FD bus)"

bool cfg_takes_fd(const schema *self)
{
    const cfg_walk *walk = self->user;

    return walk->any_node || cfg_has_fd(walk->config);
}

/* Complains about a frame that the controller of a node refuses. */
static void check_variants(schema *self, const schema_key *key, const yaml_node_t *value,
                           const cw_frame *frame, const cfg_node *sender)
{
    const unsigned variants = sender->controller.variants;

    if (cw_frame_is_refused(frame, variants & CW_VARIANT_NO_HIGH_IDS))
        schema_problem(self, key, value,
                       schema_print(self, "an identifier whose first seven bits are all recessive, "
                                    "which the controller of '%s' refuses (high-identifiers: off)",
                                    sender->name));
    if (cw_frame_is_refused(frame, variants & CW_VARIANT_NO_LONG_DLC))
        schema_problem(self, key, value,
                       schema_print(self, "a DLC above 8, which the controller of '%s' refuses "
                                    "(dlc-over-8: off)", sender->name));
}

void cfg_check_sender(schema *self, const schema_key *key, const yaml_node_t *value,
                      const cw_frame *frame, size_t node)
{
    const cfg_walk *walk = self->user;
    const bool known = node < walk->config->node_count; /* else there is an error already */
    const cfg_node *sender = known ? &walk->config->nodes[node] : NULL;

    if (sender && !walk->any_node && (frame->flags & CW_FRAME_EXTENDED) && cfg_is_old(sender))
        schema_problem(self, key, value,
                       schema_print(self, "an extended frame, but the node '%s' sends base frames "
                                    "only (kind: classical makes it send both)", sender->name));
    if (sender && !walk->any_node)
        check_variants(self, key, value, frame, sender);
    if (!(frame->flags & CW_FRAME_FD) || walk->any_node || !sender ||
        cfg_knows_fd(walk->config, sender))
        return;
    schema_problem(self, key, value,
                   cfg_has_fd(walk->config)
                       ? schema_print(self,
                                      "a CAN FD frame (##), but the node '%s' knows classical "
                                      "frames only (kind: fd makes it know both)",
                                      sender->name)
                       : "a CAN FD frame (##), but the bus is classical " MAKES_FD);
}

const char *cfg_parse_bytes(const schema *self, text_bytes *out, const char *text)
{
    const bool fd = cfg_takes_fd(self);
    const char *problem = text_parse_bytes(out, text, fd);
    text_bytes longer;

    if (problem && !fd && !text_parse_bytes(&longer, text, true))
        problem = "more than 8 data bytes, but the bus is classical " MAKES_FD;
    return problem;
}

/* Reads a frame. Its node is checked later: cfg_check_sender(). */
void cfg_read_frame(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const char *text = schema_text(self, key, value, "a frame such as 123#DEADBEEF");
    cw_frame frame = {0};

    if (!text)
        return;
    const char *problem = text_parse_frame(&frame, text);
    schema_problem(self, key, value, problem);
    if (!problem)
        *(cw_frame *)schema_member(key, object) = frame;
}

/* Reads a filter of frames, or a mask of error frames. */
static void read_filter(schema *self, const schema_key *key, yaml_node_t *value, cw_rule *rule)
{
    unsigned room = CW_RULE_FILTERS_MAX - rule->filter_count;
    unsigned count = 0;
    uint32_t mask = 0;
    const char *text = schema_text(self, key, value, "a frame filter such as 123 or 100:700");

    if (!text)
        return;
    if (*text == '#')
        schema_problem(self, key, value, text_parse_error_mask(&mask, text));
    else
        schema_problem(self, key, value,
                       text_parse_filters(rule->filters + rule->filter_count, &count, room, text));
    rule->filter_count = (uint8_t)(rule->filter_count + count);
    rule->error_mask |= mask;
}

unsigned cfg_read_filter_list(schema *self, const schema_key *key, yaml_node_t *value,
                              cw_filter *filters, unsigned count, unsigned most)
{
    const size_t texts = schema_count_one(self, key, value, 1, most);
    for (size_t i = 0; i < texts; i++) {
        yaml_node_t *item = schema_item(self, value, i);
        const char *text = schema_text(self, key, item, "a frame filter such as 123 or 100:700");
        unsigned more = 0;
        if (!text)
            continue;
        schema_problem(self, key, item,
                       text_parse_filters(&filters[count], &more, most - count, text));
        count += more;
    }
    return count;
}

/* Reads one text or a list of them. */
void cfg_read_filters(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    size_t count = schema_count_one(self, key, value, 1, CW_RULE_FILTERS_MAX);

    for (size_t i = 0; i < count; i++) {
        yaml_node_t *item = schema_item(self, value, i);

        if (!schema_is_open(self, item))
            read_filter(self, key, item, object);
    }
}

void cfg_read_data(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_rule *rule = object;
    text_bytes bytes = {0};
    const char *text = schema_text(self, key, value, "data bytes such as DEAD..EF");

    if (text)
        schema_problem(self, key, value, cfg_parse_bytes(self, &bytes, text));
    rule->data_length = bytes.length;
    memcpy(rule->data_mask, bytes.mask, sizeof bytes.mask);
    memcpy(rule->data_value, bytes.value, sizeof bytes.value);
}

/* Reads one end of a window in ticks; returns false after a complaint. */
static bool read_end(schema *self, uint64_t *tick, const schema_key *key, const yaml_node_t *value,
                     const char *text)
{
    cfg_time time = {0};
    const char *problem = text_parse_time(&time, text);

    schema_problem(self, key, value, problem);
    *tick = text_time_ticks(time, cfg_of(self)->rate);
    return !problem;
}

/* Reads BEGIN, BEGIN.., BEGIN..END or ..END, half open. */
void cfg_read_window(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const char expected[] = "a time or a window such as 2s, 2s.., 2s..5s or ..5s";
    cw_rule *rule = object;
    const char *text = schema_text(self, key, value, expected);

    if (!text)
        return;
    const char *dots = strstr(text, "..");
    size_t length = dots ? (size_t)(dots - text) : strlen(text);
    const char *end = dots ? dots + 2 : "";
    if (length == 0 && *end == '\0') {
        schema_expected(self, key, value, expected);
        return;
    }
    const char *begin = schema_print(self, "%.*s", (int)length, text);
    if (!begin || (length > 0 && !read_end(self, &rule->time_begin, key, value, begin)))
        return;
    if (*end == '\0' || !read_end(self, &rule->time_end, key, value, end))
        return;
    if (rule->time_end <= rule->time_begin)
        schema_problem(self, key, value, "the window must end after it begins");
}

/* ---- Nodes and their states ------------------------------------------------------------------ */

/* Complains about a node that does not exist, with a guess or all that do. */
static void complain_no_node(schema *self, const schema_key *key, const yaml_node_t *value,
                             const char *name)
{
    const cfg *config = cfg_of(self);
    nearest guess = {.word = name};
    const char *list = "";

    for (size_t i = 0; i < config->node_count; i++) {
        nearest_consider(&guess, config->nodes[i].name);
        list = schema_join(self, list, config->nodes[i].name);
    }
    /* Without any node, the missing list of nodes is the only useful complaint. */
    if (config->node_count > 0)
        schema_complain(self, value, "%s: there is no node '%.40s'%s", key->name, name,
                        schema_allowed(self, &guess, list));
}

/* Makes a further node of that name, for a profile that is checked without a bus. Returns its index
 * or -1. */
static int make_node(schema *self, const schema_key *key, const yaml_node_t *value,
                     const char *name)
{
    cfg *config = cfg_of(self);

    if (!cfg_name_valid(name, NODE_NAME_MAX)) {
        schema_expected(self, key, value, "the name of a node");
        return -1;
    }
    if (config->node_count == CW_NODES_MAX) {
        schema_complain(self, value, "%s: these are more than %d nodes", key->name, CW_NODES_MAX);
        return -1;
    }
    char *copy = schema_copy(self, name);
    if (!copy)
        return -1;
    config->nodes[config->node_count].name = copy;
    return (int)config->node_count++;
}

int cfg_read_node(schema *self, const schema_key *key, const yaml_node_t *value, const char *name)
{
    const cfg_walk *walk = self->user;
    uint8_t node = cfg_find_node(walk->config, name);

    if (node != CW_NO_NODE)
        return node;
    if (walk->any_node)
        return make_node(self, key, value, name);
    if (!walk->unnamed) /* a node whose name was reported may have this name */
        complain_no_node(self, key, value, name);
    return -1;
}

void cfg_read_node_index(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    uint8_t *member = schema_member(key, object);
    const char *name = schema_text(self, key, value, "the name of a node");
    int node = name ? cfg_read_node(self, key, value, name) : -1;

    if (node >= 0)
        *member = (uint8_t)node;
}

uint64_t cfg_read_node_mask(schema *self, const schema_key *key, const yaml_node_t *value)
{
    if (schema_is_open(self, value))
        return 0;
    const char *name = schema_text(self, key, value, "the name of a node");
    int node = name ? cfg_read_node(self, key, value, name) : -1;

    return node < 0 ? 0 : UINT64_C(1) << node;
}

/* Reads a node or a list of nodes as a set. */
void cfg_read_node_set(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    uint64_t *set = schema_member(key, object);
    size_t count = schema_count_one(self, key, value, 1, CW_NODES_MAX);

    for (size_t i = 0; i < count; i++) {
        yaml_node_t *item = schema_item(self, value, i);
        uint64_t node = cfg_read_node_mask(self, key, item);
        if (*set & node)
            schema_complain(self, item, "%s: this node is in the list twice", key->name);
        *set |= node;
    }
}

uint8_t cfg_read_states(schema *self, const schema_key *key, yaml_node_t *value)
{
    schema_choice choices[STATES_MAX + 1] = {{.name = NULL}};
    size_t count = schema_count_one(self, key, value, 1, STATES_MAX);
    unsigned mask = 0;
    unsigned state;

    for (unsigned i = 0; i < STATES_MAX; i++)
        choices[i] = (schema_choice){.name = cw_state_name((cw_state)i), .value = i};
    for (size_t i = 0; i < count; i++) {
        yaml_node_t *item = schema_item(self, value, i);
        if (!schema_is_open(self, item) && schema_choose(self, &state, key, item, choices))
            mask |= 1u << state;
    }
    return (uint8_t)mask;
}

/* ---- Places of rules ------------------------------------------------------------------------ */

/* Parses a named bit of a frame. One that only CAN FD has is explained on a classical bus. */
static const char *parse_position(const schema *self, cw_rule *rule, const char *text)
{
    const bool fd = cfg_takes_fd(self);
    const char *problem = text_parse_position(&rule->field, &rule->index, text, fd);
    cw_field field;
    uint16_t index;

    if (problem && !fd && !text_parse_position(&field, &index, text, true))
        problem = "only CAN FD frames have this position, but the bus is classical " MAKES_FD;
    return problem;
}

/* On a classical bus a rule for the data rate would never match. */
void cfg_read_rate(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cw_phase_rate *rate = schema_member(key, object);

    schema_read_choice(self, key, value, object);
    if (*rate == CW_RATE_DATA && !cfg_takes_fd(self))
        schema_problem(self, key, value,
                       "no frame has a data rate, as the bus is classical " MAKES_FD);
}

void cfg_read_position(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_rule *rule = object;
    const char *text = schema_text(self, key, value, "a position such as crc[3]");

    if (text)
        schema_problem(self, key, value, parse_position(self, rule, text));
}

/* Reads wire, NODE.tx or NODE.rx; names of nodes may contain points. */
void cfg_read_line(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const char expected[] = "wire, NODE.tx or NODE.rx";
    cw_rule *rule = object;
    const char *text = schema_text(self, key, value, expected);

    if (!text || strcmp(text, "wire") == 0)
        return;
    const char *point = strrchr(text, '.');
    bool tx = point && strcmp(point, ".tx") == 0;
    if (!tx && !(point && strcmp(point, ".rx") == 0)) {
        schema_expected(self, key, value, expected);
        return;
    }
    const char *name = schema_print(self, "%.*s", (int)(point - text), text);
    int node = name ? cfg_read_node(self, key, value, name) : -1;
    rule->line = tx ? CW_LINE_TX : CW_LINE_RX;
    rule->node = (uint8_t)(node < 0 ? 0 : node);
}

yaml_node_t *cfg_node_map(schema *self, yaml_node_t *nodes, size_t i)
{
    const cfg_walk *walk = self->user;
    const bool is_list = nodes->type == YAML_SEQUENCE_NODE;
    const size_t count =
        is_list ? (size_t)(nodes->data.sequence.items.top - nodes->data.sequence.items.start) : 1;

    return i < count || !walk->guests ? schema_item(self, nodes, i) : walk->guests;
}
