/* SPDX-License-Identifier: MIT
 *
 * mailbox.c - the mailboxes of a node's controller: their number, or a list.
 */
#include "config/parts.h"

#include "trace/frametext.h"

#include <string.h>

#define LEAST 8u /* as a number; a list names the ones in use */

static const char expected_number[] = "a number of mailboxes, 8..64, or a list of them";

/* One map of the list. */
typedef struct mailbox_keys {
    unsigned direction; /* cw_mailbox_use */
    bool reply;
    bool has_id;
    bool has_data;
    cw_mailbox box;
} mailbox_keys;

static const schema_choice directions[] = {
    {.name = "rx", .value = CW_MAILBOX_RECEIVE},
    {.name = "tx", .value = CW_MAILBOX_TRANSMIT},
    {.name = NULL},
};

static const schema_choice replies[] = {
    {.name = "auto", .value = true},
    {.name = NULL},
};

/* ---- Keys ------------------------------------------------------------------------------------ */

/* There is room for two filters, so that a second one is noticed. */
static void mailbox_read_id(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    mailbox_keys *keys = object;
    static const char expected[] = "one frame filter, such as 123 or 100:700";
    const char *text = schema_text(self, key, value, expected);
    cw_filter filters[2] = {{0}};
    unsigned count = 0;

    keys->has_id = true;
    if (text)
        schema_problem(self, key, value, text_parse_filters(filters, &count, 2, text));
    if (count > 1)
        schema_expected(self, key, value, expected);
    keys->box.filter = filters[0];
}

static void read_reply(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    unsigned reply;

    ((mailbox_keys *)object)->reply = true;
    (void)schema_choose(self, &reply, key, value, replies);
}

/* Bytes must be known as a whole: open digits make sense in filters only. */
static void mailbox_read_data(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const char expected[] = "1 to 8 bytes in hexadecimal digits, such as DEADBEEF";
    cw_frame *frame = &((mailbox_keys *)object)->box.frame;
    const char *text = schema_text(self, key, value, expected);
    text_bytes bytes = {.length = 0};

    ((mailbox_keys *)object)->has_data = true;
    if (!text)
        return;
    bool exact = text_parse_bytes(&bytes, text, false) == NULL;
    for (unsigned i = 0; i < bytes.length; i++)
        exact = exact && bytes.mask[i] == 0xFF;
    if (!exact)
        schema_expected(self, key, value, expected);
    frame->dlc = bytes.length;
    memcpy(frame->data, bytes.value, bytes.length);
}

const schema_key cfg_mailbox_keys[] = {
    {.name = "direction", .read = schema_read_choice,
     .offset = offsetof(mailbox_keys, direction), .arg = directions, .required = true,
     .help = "For received frames, or for frames to send."},
    {.name = "id", .read = mailbox_read_id, .type = "nodeFilter",
     .help = "The frames that it takes. Default: all. With `reply`, one identifier."},
    {.name = "reply", .read = read_reply, .needs = "id", .type = "{'const': 'auto'}",
     .help = "It keeps the data frame that its host writes, and answers remote frames with it."},
    {.name = "data", .read = mailbox_read_data, .needs = "reply",
     .type = "{'type': ['string', 'integer'], 'pattern': '^([0-9A-Fa-f]{2} *){1,8}$'}",
     .help = "With `reply`: the data up to what the host writes."},
    {.name = NULL,
     .type = TYPE_IF(TYPE_NEEDS("reply"), "{'properties': {'direction': {'const': 'tx'}}}")},
};

/* ---- One mailbox ----------------------------------------------------------------------------- */

static bool is_one_id(const cw_filter *filter)
{
    return !filter->inverted && (filter->mask == CW_FILTER_BASE_MASK ||
                                 filter->mask == CW_FILTER_EXTENDED_MASK);
}

/* Makes a mailbox that answers remote frames of one identifier. */
static void complete_reply(schema *self, const yaml_node_t *map, mailbox_keys *keys)
{
    cw_mailbox *box = &keys->box;

    if (keys->direction == CW_MAILBOX_RECEIVE)
        schema_complain(self, map, "reply: only a mailbox with `direction: tx` can answer");
    else if (!keys->has_id || !is_one_id(&box->filter))
        schema_complain(self, map, "reply: a mailbox answers remote frames of one identifier: id: "
                        "123, or 12345678");
    box->use = CW_MAILBOX_REPLY;
    box->filled = keys->has_data;
    box->frame.id = box->filter.value & CW_EXTENDED_ID_MAX;
    if (box->filter.value & CW_FILTER_EXTENDED)
        box->frame.flags = CW_FRAME_EXTENDED;
}

/* Reads a mailbox. Keys that make no sense together are complained about when all are known. */
static void read_mailbox(schema *self, const schema_key *key, yaml_node_t *map, cw_mailbox *out)
{
    mailbox_keys keys = {.direction = CW_MAILBOX_RECEIVE};

    schema_map(self, key->name, map, cfg_mailbox_keys, &keys);
    keys.box.use = (cw_mailbox_use)keys.direction;
    if (keys.reply)
        complete_reply(self, map, &keys);
    else if (keys.has_data)
        schema_complain(self, map, "data: only a mailbox with `reply: auto` has data of its own");
    *out = keys.box;
}

/* ---- All of them ----------------------------------------------------------------------------- */

void cfg_add_mailboxes(schema *self, cfg_controller *controller, unsigned receive,
                       unsigned transmit)
{
    const unsigned count = receive + transmit;

    controller->mailbox_count = 0;
    controller->mailboxes = schema_alloc(self, count, sizeof *controller->mailboxes);
    if (!controller->mailboxes)
        return;
    controller->mailbox_count = (uint8_t)count;
    for (unsigned i = receive; i < count; i++)
        controller->mailboxes[i].use = CW_MAILBOX_TRANSMIT;
}

/* Mailboxes of a list receive until their keys say otherwise. */
static void read_list(schema *self, const schema_key *key, yaml_node_t *list,
                      cfg_controller *controller)
{
    const size_t count = schema_count(self, key, list, 1, CW_MAILBOXES_MAX);

    cfg_add_mailboxes(self, controller, (unsigned)count, 0);
    for (unsigned i = 0; i < controller->mailbox_count; i++)
        read_mailbox(self, key, schema_item(self, list, i), &controller->mailboxes[i]);
}

/* Half of a number of mailboxes receive, and one more if it is odd. */
void cfg_read_mailboxes(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const schema_range range = {LEAST, CW_MAILBOXES_MAX, sizeof(uint32_t)};
    const schema_key number_key = {.name = key->name, .arg = &range};
    cfg_controller *controller = &((cfg_node *)object)->controller;
    uint32_t number = 0;

    controller->receive_fifo = false;
    controller->receive_bytes = 0;
    if (value->type == YAML_MAPPING_NODE) {
        schema_expected(self, key, value, expected_number);
    } else if (value->type == YAML_SEQUENCE_NODE) {
        read_list(self, key, value, controller);
    } else {
        schema_read_uint(self, &number_key, value, &number);
        cfg_add_mailboxes(self, controller, number - number / 2, number / 2);
    }
}
