/* SPDX-License-Identifier: MIT
 *
 * protect.c - counters and checksums of periodic frames: the keys `counter` and `checksum`.
 *
 * AUTOSAR's profiles are those of the E2E Protocol Specification (AUTOSAR_PRS_E2EProtocol). Each is
 * a checksum with a counter of its own.
 */
#include "config/protect.h"

#include "config/values.h"

#include <stdlib.h>
#include <string.h>

#define BITS_DEFAULT 4u
#define COUNTER_BITS_MAX 32u
#define PLACES (CW_FRAME_DATA_MAX * 8u)
#define NIBBLE 4u

typedef enum id_form {
    ID_BYTES = 0, /* a byte, or a list of bytes */
    ID_NUMBER,    /* 16 bits */
    ID_MODES,     /* the same, of which the mode says what takes part */
    ID_LIST       /* 16 bytes, of which each counter has its own */
} id_form;

/* A kind of checksum. */
typedef struct checksum_kind {
    cw_checksum_kind kind;
    uint16_t polynomial;
    uint16_t start;
    uint16_t inverted;
    bool id_first;
    id_form id;
    bool nibbles_only; /* the Data ID has only the modes both and nibble */
    /* the counter of a profile; bits 0: the kind has none */
    uint8_t bits;
    uint8_t byte;    /* behind that of the checksum */
    uint8_t max;
    uint8_t first;   /* value */
    bool moves;      /* `at` may say another half of a byte */
} checksum_kind;

/* In the order of `kinds`. Profiles 1 and 11 have the CRC of SAE J1850 without its inversions, see
 * PRS_E2E_00190. Profiles 2 and 22 count before they protect. */
static const checksum_kind table[] = {
    {.kind = CW_CHECKSUM_XOR},
    {.kind = CW_CHECKSUM_SUM},
    {.kind = CW_CHECKSUM_CRC8, .polynomial = 0x1D, .start = 0xFF, .inverted = 0xFF,
     .id_first = true},
    {.kind = CW_CHECKSUM_CRC8, .polynomial = 0x2F, .start = 0xFF, .inverted = 0xFF},
    {.kind = CW_CHECKSUM_CRC8, .polynomial = 0x1D, .id_first = true, .id = ID_MODES, .bits = 4,
     .byte = 1, .max = 14, .moves = true},
    {.kind = CW_CHECKSUM_CRC8, .polynomial = 0x2F, .start = 0xFF, .inverted = 0xFF, .id = ID_LIST,
     .bits = 4, .byte = 1, .max = 15, .first = 1},
    {.kind = CW_CHECKSUM_CRC16, .polynomial = 0x1021, .start = 0xFFFF, .id = ID_NUMBER, .bits = 8,
     .byte = 2, .max = 255},
    {.kind = CW_CHECKSUM_CRC8, .polynomial = 0x1D, .id_first = true, .id = ID_MODES,
     .nibbles_only = true, .bits = 4, .byte = 1, .max = 14, .moves = true},
    {.kind = CW_CHECKSUM_CRC8, .polynomial = 0x2F, .start = 0xFF, .inverted = 0xFF, .id = ID_LIST,
     .bits = 4, .byte = 1, .max = 15, .first = 1},
};

enum { XOR, SUM, CRC8_J1850, CRC8_H2F, E2E_P1, E2E_P2, E2E_P5, E2E_P11, E2E_P22 };

static const schema_choice kinds[] = {
    {.name = "xor", .value = XOR},
    {.name = "sum", .value = SUM},
    {.name = "crc8-j1850", .value = CRC8_J1850},
    {.name = "crc8-h2f", .value = CRC8_H2F},
    {.name = "e2e-p1", .value = E2E_P1},
    {.name = "e2e-p2", .value = E2E_P2},
    {.name = "e2e-p5", .value = E2E_P5},
    {.name = "e2e-p11", .value = E2E_P11},
    {.name = "e2e-p22", .value = E2E_P22},
    {.name = "p1", .value = E2E_P1},
    {.name = "p2", .value = E2E_P2},
    {.name = "p5", .value = E2E_P5},
    {.name = "p11", .value = E2E_P11},
    {.name = "p22", .value = E2E_P22},
    {.name = NULL},
};

enum { MODE_BOTH, MODE_ALT, MODE_LOW, MODE_NIBBLE };

static const schema_choice modes[] = {
    {.name = "both", .value = MODE_BOTH},
    {.name = "alt", .value = MODE_ALT},
    {.name = "low", .value = MODE_LOW},
    {.name = "nibble", .value = MODE_NIBBLE},
    {.name = NULL},
};

static schema_reader read_place, protect_read_id;

static const schema_range bits_range = {1, COUNTER_BITS_MAX, sizeof(uint8_t)};
static const schema_range byte_range = {0, CW_FRAME_DATA_MAX - 1, sizeof(uint8_t)};
static const schema_range value_range = {0, UINT32_MAX, sizeof(uint32_t)};

#define PLACE "^(?:(?:[0-9]|[1-5][0-9]|6[0-3])(?:\\.[0-7])?)$"
#define BYTE_TEXT                                                                                  \
    TYPE_TEXT("^(?:0x[0-9A-Fa-f]{1,2}|[0-9]|[1-9][0-9]|1[0-9]{2}|2[0-4][0-9]|25[0-5])$")
#define NUMBER_TEXT                                                                                \
    TYPE_TEXT("^(?:0x[0-9A-Fa-f]{1,4}|[0-9]|[1-9][0-9]{1,3}|[1-5][0-9]{4}|6[0-4][0-9]{3}|"         \
              "65[0-4][0-9]{2}|655[0-2][0-9]|6553[0-5])$")
#define KIND(words) "{'properties': {'kind': {'enum': [" words "]}}, 'required': ['kind']}"

#define MEMBER(m) .offset = offsetof(cfg_protect, m)

const schema_key cfg_counter_keys[] = {
    {.name = "at", .read = read_place, MEMBER(what.counter.bit),
     .type = "{'type': ['string', 'number'], 'pattern': '" PLACE "', 'examples': ['1.4']}",
     .help = "Its most significant bit, BYTE.BIT as in data[BYTE.BIT]: bit 0 is the most "
             "significant. A profile of AUTOSAR has a place of its own."},
    {.name = "bits", .read = schema_read_uint, MEMBER(what.counter.bits), .arg = &bits_range,
     .preset = "4",
     .help = "How long it is."},
    {.name = "max", .read = schema_read_uint, MEMBER(what.counter.max), .arg = &value_range,
     .help = "After it comes 0; default: all bits 1."},
    {.name = "start", .read = schema_read_uint, MEMBER(what.counter.start), .arg = &value_range,
     .help = "Of the first frame; default 0, with e2e-p2 and e2e-p22 1."},
    {.name = NULL},
};

const schema_key cfg_checksum_keys[] = {
    {.name = "kind", .read = schema_read_choice, MEMBER(kind), .arg = kinds, .required = true,
     .help = "How it is computed. e2e-p1 to e2e-p22 are AUTOSAR's profiles, which have a "
             "counter, too."},
    {.name = "at", .read = schema_read_uint, MEMBER(what.checksum.at), .arg = &byte_range,
     .required = true,
     .help = "Its byte; e2e-p5 has two, the low one first."},
    {.name = "data-id", .read = protect_read_id,
     .type = TYPE_ANY(NUMBER_TEXT ", " TYPE_LIST(1, 16, BYTE_TEXT)),
     .help = "What takes part in the checksum and is not sent: of e2e-p1, e2e-p5 and e2e-p11 a "
             "number, of e2e-p2 and e2e-p22 a list of 16 bytes, else a byte or a list of bytes."},
    {.name = "data-id-mode", .read = schema_read_choice, MEMBER(mode), .arg = modes,
     .preset = "both",
     .help = "Of e2e-p1, what of the Data ID takes part; e2e-p11 has both and nibble."},
    {.name = "data-id-nibble", .read = read_place, MEMBER(nibble),
     .type = TYPE_TEXT(PLACE),
     .help = "With the mode nibble: where bits 8 to 11 of the Data ID are sent. Default: the "
             "first half of the byte behind the checksum."},
    {.name = NULL,
     .type = "{'allOf': ["
             TYPE_IF(KIND("'e2e-p1', 'p1', 'e2e-p11', 'p11', 'e2e-p5', 'p5'"),
                     "{'required': ['data-id'], 'properties': {'data-id': {'not': "
                     "{'type': 'array'}}}}") ", "
             TYPE_IF(KIND("'e2e-p2', 'p2', 'e2e-p22', 'p22'"),
                     "{'required': ['data-id'], 'properties': {'data-id': "
                     "{'type': 'array', 'minItems': 16}}}") ", "
             TYPE_IF(KIND("'xor', 'sum', 'crc8-j1850', 'crc8-h2f'"),
                     "{'properties': {'data-id': " TYPE_ANY("{'type': 'array'}, " BYTE_TEXT) "}}")
             ", " TYPE_IF("{'not': " KIND("'e2e-p1', 'p1', 'e2e-p11', 'p11'") "}",
                          "{'properties': {'data-id-mode': false, 'data-id-nibble': false}}")
             ", " TYPE_IF(KIND("'e2e-p11', 'p11'"),
                          "{'properties': {'data-id-mode': {'enum': ['both', 'nibble']}}}") "]}"},
};

/* cfg_complete_protection() completes it when the checksum is read, too: a profile has both. */
void cfg_read_counter(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_traffic *traffic = object;

    traffic->protect.has_counter = true;
    schema_map(self, key->name, value, cfg_counter_keys, &traffic->protect);
}

/* cfg_complete_protection() completes it by the kind. */
void cfg_read_checksum(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_traffic *traffic = object;

    traffic->protect.has_checksum = true;
    schema_map(self, key->name, value, cfg_checksum_keys, &traffic->protect);
}

/* ---- Values ---------------------------------------------------------------------------------- */

/* Reads a number such as 291 or 0x123, with at most as many digits as the limit has. */
static bool parse_number(uint16_t *out, const char *text, unsigned most)
{
    const size_t digits = strlen(text) - 2, digits_max = most > UINT8_MAX ? 4 : 2;
    uint64_t number = 0;
    uint32_t hex = 0;
    const bool is_hex = strncmp(text, "0x", 2) == 0;
    const bool good = is_hex ? digits <= digits_max && text_parse_hex(&hex, text + 2, digits)
                             : text_take_uint(&number, &text, most) && *text == '\0';

    if (good)
        *out = (uint16_t)(is_hex ? hex : number);
    return good;
}

/* Reads BYTE.BIT, or BYTE for its first bit. */
static void read_place(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const char expected[] = "BYTE.BIT from 0.0 to 63.7, bit 0 is the most significant";
    const char *text = schema_text(self, key, value, expected);
    uint16_t *place = schema_member(key, object);
    uint64_t byte = 0, bit = 0;

    if (!text)
        return;
    bool good = text_take_uint(&byte, &text, CW_FRAME_DATA_MAX - 1);
    if (good && *text == '.') {
        text++;
        good = text_take_uint(&bit, &text, 7);
    }
    if (good && *text == '\0')
        *place = (uint16_t)(8 * byte + bit);
    else
        schema_expected(self, key, value, expected);
}

/* Reads a byte or a number of 16 bits, decimal or hexadecimal; `most` is the limit. */
static void read_id_number(schema *self, const schema_key *key, const yaml_node_t *value,
                           uint16_t *out, unsigned most)
{
    static const char *const expected[] = {
        "a byte, 0..255 or 0x00..0xFF",
        "a number 0..65535 or 0x0000..0xFFFF, or a list of bytes",
    };
    const char *what = expected[most > UINT8_MAX];
    const char *text = schema_text(self, key, value, what);

    if (text && !parse_number(out, text, most))
        schema_expected(self, key, value, what);
}

/* Reads a data ID: a number, or a list of bytes. */
static void protect_read_id(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_protect *p = object;

    if (value->type != YAML_SEQUENCE_NODE) {
        p->id_count = 1;
        read_id_number(self, key, value, &p->id[0], UINT16_MAX);
        return;
    }
    p->id_count = (uint8_t)schema_count(self, key, value, 1, CW_DATA_ID_MAX);
    p->id_list = true;
    for (size_t i = 0; i < p->id_count; i++)
        read_id_number(self, key, schema_item(self, value, i), &p->id[i], UINT8_MAX);
}

/* ---- Completing ------------------------------------------------------------------------------ */

/* The values of an entry, for complaints. */
typedef struct entry {
    yaml_node_t *counter;  /* or NULL */
    yaml_node_t *checksum;
    cfg_protect *p;
    const checksum_kind *kind; /* or NULL */
    cw_frame *frame;
} entry;

/* Returns the place of a key for complaints; that of its map when the map has no such key. */
static const yaml_node_t *at_key(schema *self, const yaml_node_t *map, const char *name)
{
    const yaml_node_t *value = schema_find(self, map, name);

    return value ? value : map;
}

static bool has(schema *self, const yaml_node_t *map, const char *name)
{
    return map && schema_find(self, map, name);
}

static const char *protect_name_of(const cfg_protect *p)
{
    return kinds[p->kind].name;
}

/* Complains about a number of a profile's counter that the profile does not allow. */
static void check_fixed(schema *self, const entry *e, const char *key, unsigned is, unsigned must)
{
    if (has(self, e->counter, key) && is != must)
        schema_complain(self, at_key(self, e->counter, key), "%s: the counter of '%s' has %s %u",
                        key, protect_name_of(e->p), key, must);
}

/* Gives a profile its counter, with what `counter` says of it. */
static void complete_profile_counter(schema *self, const entry *e)
{
    const checksum_kind *k = e->kind;
    cw_counter *n = &e->p->what.counter;
    const unsigned byte = (unsigned)e->p->what.checksum.at + k->byte;
    const unsigned usual = 8 * byte + (k->bits == NIBBLE ? NIBBLE : 0);
    const bool at = has(self, e->counter, "at");

    check_fixed(self, e, "bits", n->bits, k->bits);
    check_fixed(self, e, "max", n->max, k->max);
    if (at && !k->moves && n->bit != usual)
        schema_complain(self, at_key(self, e->counter, "at"),
                        "at: the counter of '%s' is at %u.%u, behind the checksum",
                        protect_name_of(e->p), usual / 8, usual % 8);
    if (at && k->moves && n->bit % NIBBLE != 0)
        schema_complain(self, at_key(self, e->counter, "at"),
                        "at: the counter of '%s' is half a byte, at BYTE.0 or BYTE.4",
                        protect_name_of(e->p));
    if (!at)
        n->bit = (uint16_t)usual;
    if (!has(self, e->counter, "start"))
        n->start = k->first;
    n->bits = k->bits;
    n->max = k->max;
}

/* Completes a counter: its size and its highest value, which must fit each other. */
static void complete_counter(schema *self, const entry *e)
{
    cw_counter *n = &e->p->what.counter;

    if (!has(self, e->counter, "at"))
        schema_complain(self, e->counter, "counter: the key 'at' is missing");
    if (n->bits == 0)
        n->bits = BITS_DEFAULT;
    const uint32_t most = UINT32_MAX >> (COUNTER_BITS_MAX - n->bits);
    if (!has(self, e->counter, "max"))
        n->max = most;
    if (n->max > most)
        schema_complain(self, at_key(self, e->counter, "max"), "max: %u bits have at most %u",
                        n->bits, most);
}

static void set_id(cw_checksum *c, unsigned first, unsigned second, unsigned length)
{
    c->id[0] = (uint8_t)first;
    c->id[1] = (uint8_t)second;
    c->id_length = (uint8_t)length;
}

/* Writes the bits 8 to 11 of the Data ID into the data, where its mode wants them. */
static void write_nibble(schema *self, const entry *e)
{
    cfg_protect *p = e->p;
    const bool given = has(self, e->checksum, "data-id-nibble");
    const unsigned place = given ? p->nibble : 8 * (p->what.checksum.at + 1u);
    const yaml_node_t *at = at_key(self, e->checksum, "data-id-nibble");

    if (place % NIBBLE != 0)
        schema_complain(self, at, "data-id-nibble: it is half a byte, at BYTE.0 or BYTE.4");
    else if (place / 8 >= cw_frame_length(e->frame))
        schema_complain(self, at, "data-id-nibble: the frame has %u data bytes, no %u.%u",
                        cw_frame_length(e->frame), place / 8, place % 8);
    else if (place == p->what.counter.bit || place / 8 == p->what.checksum.at)
        schema_complain(self, at, "data-id-nibble: counter or checksum are at %u.%u", place / 8,
                        place % 8);
    else
        cw_protection_write(&(cw_protection){.counter = {.bit = (uint16_t)place, .bits = NIBBLE}},
                            e->frame, (uint32_t)p->id[0] >> 8);
}

/* Completes the data ID of kinds whose mode says which of its bytes are used. */
static void complete_modes(schema *self, const entry *e)
{
    cfg_protect *p = e->p;
    cw_checksum *c = &p->what.checksum;
    const unsigned low = p->id[0] & 0xFFu, high = p->id[0] >> 8;

    if (e->kind->nibbles_only && p->mode != MODE_BOTH && p->mode != MODE_NIBBLE)
        schema_complain(self, at_key(self, e->checksum, "data-id-mode"),
                        "data-id-mode: '%s' has both and nibble", protect_name_of(p));
    if (p->mode == MODE_NIBBLE && high > 0xF)
        schema_complain(self, at_key(self, e->checksum, "data-id"),
                        "data-id: at most 0xFFF with the mode nibble");
    set_id(c, low, p->mode == MODE_NIBBLE ? 0 : high, p->mode == MODE_LOW ? 1 : 2);
    c->id_by_counter = p->mode == MODE_ALT;
    if (p->mode == MODE_NIBBLE)
        write_nibble(self, e);
}

/* Complains about a Data ID whose form is not that of the kind. Returns false then. */
static bool check_id_form(schema *self, const entry *e)
{
    static const char *const wanted[] = {
        [ID_BYTES] = "a byte, or a list of bytes",
        [ID_NUMBER] = "a number 0..65535",
        [ID_MODES] = "a number 0..65535",
        [ID_LIST] = "a list of 16 bytes",
    };
    const cfg_protect *p = e->p;
    const id_form form = e->kind->id;
    const bool list = form == ID_LIST ? p->id_list && p->id_count == CW_DATA_ID_MAX : !p->id_list;
    const bool bytes = p->id_list || p->id[0] <= UINT8_MAX;

    if (p->id_count == 0 && form == ID_BYTES)
        return true;
    if (p->id_count > 0 && (form == ID_BYTES ? bytes : list))
        return true;
    schema_complain(self, at_key(self, e->checksum, "data-id"), "data-id: '%s' needs %s",
                    protect_name_of(p), wanted[form]);
    return false;
}

/* Completes the data ID, in the form that the kind of checksum has. */
static void complete_id(schema *self, const entry *e)
{
    const cfg_protect *p = e->p;
    cw_checksum *c = &e->p->what.checksum;
    const id_form form = e->kind->id;

    for (unsigned i = 0; form != ID_MODES && i < 2; i++) {
        static const char *const names[] = {"data-id-mode", "data-id-nibble"};
        if (has(self, e->checksum, names[i]))
            schema_complain(self, at_key(self, e->checksum, names[i]),
                            "%s: only of 'e2e-p1' and 'e2e-p11'", names[i]);
    }
    if (!check_id_form(self, e))
        return;
    if (form == ID_MODES)
        complete_modes(self, e);
    else if (form == ID_NUMBER)
        set_id(c, p->id[0] & 0xFFu, p->id[0] >> 8, 2);
    for (unsigned i = 0; (form == ID_BYTES || form == ID_LIST) && i < p->id_count; i++)
        c->id[i] = (uint8_t)p->id[i];
    if (form == ID_BYTES || form == ID_LIST)
        c->id_length = p->id_count;
    c->id_by_counter = c->id_by_counter || form == ID_LIST;
}

/* Takes the polynomial and the values around it from the table of kinds. */
static void complete_checksum(cfg_protect *p, const checksum_kind *k)
{
    cw_checksum *c = &p->what.checksum;

    c->kind = k->kind;
    c->polynomial = k->polynomial;
    c->start = k->start;
    c->inverted = k->inverted;
    c->id_first = k->id_first;
}

/* Complains about places that the frame has not, or that counter and checksum share. */
static void check_places(schema *self, const entry *e)
{
    const cw_protection only_counter = {.counter = e->p->what.counter};
    const cw_protection only_checksum = {.checksum = e->p->what.checksum};
    const cw_counter *n = &e->p->what.counter;
    const cw_checksum *c = &e->p->what.checksum;
    const unsigned bytes = c->kind == CW_CHECKSUM_CRC16 ? 2 : 1;

    if (!cw_protection_fits(&only_checksum, e->frame))
        schema_complain(self, at_key(self, e->checksum, "at"),
                        "at: the checksum needs byte %u, the frame has %u data bytes",
                        c->at + bytes - 1u, cw_frame_length(e->frame));
    else if (!cw_protection_fits(&only_counter, e->frame))
        schema_complain(self, e->counter ? at_key(self, e->counter, "at") : e->checksum,
                        "at: the counter ends at %u.%u, the frame has %u data bytes",
                        (n->bit + n->bits - 1u) / 8, (n->bit + n->bits - 1u) % 8,
                        cw_frame_length(e->frame));
    else if (n->bits && c->kind && n->bit < 8 * (c->at + bytes) && n->bit + n->bits > 8 * c->at)
        schema_complain(self, at_key(self, e->counter ? e->counter : e->checksum, "at"),
                        "at: the counter is in the checksum");
}

void cfg_complete_protection(schema *self, yaml_node_t *map, cfg_traffic *traffic)
{
    const size_t errors = self->errors->errors;
    const entry e = {.counter = schema_find(self, map, "counter"),
                     .checksum = schema_find(self, map, "checksum"),
                     .p = &traffic->protect,
                     .kind = traffic->protect.has_checksum ? &table[traffic->protect.kind] : NULL,
                     .frame = &traffic->frame};

    if (e.kind)
        complete_checksum(e.p, e.kind);
    if (e.kind && e.kind->bits)
        complete_profile_counter(self, &e);
    else if (e.p->has_counter)
        complete_counter(self, &e);
    if (e.kind)
        complete_id(self, &e);
    if (e.p->what.counter.start > e.p->what.counter.max)
        schema_complain(self, at_key(self, e.counter, "start"), "start: at most %u, as 'max' says",
                        e.p->what.counter.max);
    if (self->errors->errors == errors && (e.kind || e.p->has_counter))
        check_places(self, &e);
    e.p->what.id = cw_frame_can_id(e.frame);
}

/* ---- All entries ----------------------------------------------------------------------------- */

bool cfg_is_protected(const cfg_traffic *traffic)
{
    return traffic->protect.has_counter || traffic->protect.has_checksum;
}

static bool same_counter(const cw_counter *a, const cw_counter *b)
{
    return a->bit == b->bit && a->bits == b->bits && a->max == b->max && a->start == b->start;
}

/* Compares only the bytes of the Data ID that take part. */
static bool same_checksum(const cw_checksum *a, const cw_checksum *b)
{
    return a->kind == b->kind && a->at == b->at && a->polynomial == b->polynomial &&
           a->start == b->start && a->inverted == b->inverted && a->id_first == b->id_first &&
           a->id_by_counter == b->id_by_counter && a->id_length == b->id_length &&
           memcmp(a->id, b->id, a->id_length) == 0;
}

static bool same_protection(const cw_protection *a, const cw_protection *b)
{
    return same_counter(&a->counter, &b->counter) && same_checksum(&a->checksum, &b->checksum);
}

/* Returns the first entry of a node that sends the identifier of another one. */
static size_t first_with(const cfg_node *node, const cfg_traffic *traffic)
{
    size_t i = 0;

    while (node->traffic[i].kind != CFG_TRAFFIC_SEND ||
           cw_frame_can_id(&node->traffic[i].frame) != cw_frame_can_id(&traffic->frame))
        i++;
    return i;
}

/* Entries of a node with the same identifier count together, so they must agree. */
static bool check_entries(schema *self, const yaml_node_t *list, const cfg_node *node)
{
    bool used = false;

    for (size_t i = 0; i < node->traffic_count; i++)
        used = used || cfg_is_protected(&node->traffic[i]);
    for (size_t i = 0; used && i < node->traffic_count; i++) {
        if (node->traffic[i].kind != CFG_TRAFFIC_SEND)
            continue;
        const size_t first = first_with(node, &node->traffic[i]);
        if (!same_protection(&node->traffic[first].protect.what, &node->traffic[i].protect.what))
            schema_complain(self, schema_item(self, (yaml_node_t *)list, i),
                            "traffic: entry %zu sends this identifier, too; both need the same "
                            "'counter' and 'checksum'", first + 1);
    }
    return used;
}

/* Sorts by node, then by identifier, as the library looks protections up. */
static int protect_compare(const void *left, const void *right)
{
    const cw_protection *a = left, *b = right;

    if (a->node != b->node)
        return a->node < b->node ? -1 : 1;
    return (a->id > b->id) - (a->id < b->id);
}

/* Adds the protections of a node's traffic to a list, each identifier once. Returns their
 * number. */
static size_t protect_add_node(cw_protection *list, const cfg_node *node, size_t index)
{
    size_t count = 0;

    for (size_t i = 0; i < node->traffic_count; i++) {
        const cfg_traffic *traffic = &node->traffic[i];
        if (traffic->kind != CFG_TRAFFIC_SEND || !cfg_is_protected(traffic) ||
            first_with(node, traffic) != i)
            continue;
        list[count] = traffic->protect.what;
        list[count++].node = (uint8_t)index;
    }
    return count;
}

void cfg_collect_protections(schema *self, yaml_node_t *nodes)
{
    cfg *config = cfg_of(self);
    size_t room = 0;

    for (size_t i = 0; i < config->node_count; i++) {
        yaml_node_t *map = cfg_node_map(self, nodes, i);
        const yaml_node_t *list = map && config->nodes[i].traffic_count > 0
                                      ? schema_find(self, map, "traffic") : NULL;
        if (list && check_entries(self, list, &config->nodes[i]))
            room += config->nodes[i].traffic_count;
    }
    if (room == 0)
        return;
    config->protections = schema_alloc(self, room, sizeof *config->protections);
    if (!config->protections)
        return;
    for (size_t i = 0; i < config->node_count; i++)
        config->protection_count += (uint32_t)protect_add_node(
            &config->protections[config->protection_count], &config->nodes[i], i);
    qsort(config->protections, config->protection_count, sizeof *config->protections,
          protect_compare);
}

/* ---- Rules ----------------------------------------------------------------------------------- */

static bool has_part(const cw_protection *p, cw_action action)
{
    return action == CW_ACTION_COUNTER ? p->counter.bits > 0
                                       : p->checksum.kind != CW_CHECKSUM_NONE;
}

/* Makes a frame that filters of rules can be asked about. Its data do not matter. */
static cw_frame frame_of(const cw_protection *p)
{
    const bool extended = p->id & CW_FILTER_EXTENDED;

    return (cw_frame){.id = p->id & CW_EXTENDED_ID_MAX,
                      .flags = extended ? CW_FRAME_EXTENDED : 0};
}

/* Returns true for a rule that the frames of a protection can match. */
static bool waits_for(const cw_rule *rule, const cw_protection *p)
{
    const cw_frame frame = frame_of(p);

    return (rule->from == 0 || (rule->from >> p->node & 1u)) &&
           (rule->filter_count == 0 ||
            cw_frame_matches(&frame, rule->filters, rule->filter_count));
}

/* Returns some frames that have a counter or a checksum, such as "123 of engine". */
static const char *examples(schema *self, cw_action action)
{
    const cfg *config = cfg_of(self);
    const char *list = "";
    unsigned shown = 0;

    for (size_t i = 0; i < config->protection_count && shown < 4; i++) {
        const cw_protection *p = &config->protections[i];
        const cw_frame frame = frame_of(p);
        if (!has_part(p, action))
            continue;
        const char *one = schema_print(self, frame.flags ? "%08X of %s" : "%03X of %s", frame.id,
                                       config->nodes[p->node].name);
        list = one ? schema_join(self, list, one) : list;
        shown++;
    }
    return list;
}

void cfg_check_protected(schema *self, const yaml_node_t *at, const cw_rule *rule)
{
    const cfg *config = cfg_of(self);
    const cfg_walk *walk = self->user;
    const char *name = cw_action_name(rule->action);

    for (size_t i = 0; i < config->protection_count; i++)
        if (has_part(&config->protections[i], rule->action) &&
            waits_for(rule, &config->protections[i]))
            return;
    if (walk->any_node || rule->error_mask)
        return;
    const char *list = examples(self, rule->action);
    schema_complain(self, at, "%s: no traffic that the rule waits for has a '%s'%s%s", name, name,
                    *list ? "; these have one: " : "", list);
}
