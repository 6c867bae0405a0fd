/* SPDX-License-Identifier: MIT
 *
 * type.c - what JSON schema says of the values of a configuration.
 */
#include "schema/type.h"

#include "base/text/memo.h"
#include "config/parts.h"
#include "config/values.h"
#include "timing/controllers.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- Patterns -------------------------------------------------------------------------------- */

#define DECIMAL "(?:0|[1-9][0-9]*)(?:\\.[0-9]+)?"
#define TIME "(?:0(?:\\.0+)?|" DECIMAL "(?:ns|us|ms|s|min|h)|(?:0|[1-9][0-9]*)(?:\\.0+)?bit)"
#define WINDOW TIME "|" TIME "\\.\\." TIME "?|\\.\\." TIME
#define ID "(?:[0-7][0-9A-Fa-f]{2}|[01][0-9A-Fa-f]{7})"
#define HEX "[0-9A-Fa-f]"
#define BYTE HEX "{2}"
#define FRAME                                                                                      \
    ID "#(?:[Rr](?:[0-8]|8_[9A-Fa-f])?|(?:" BYTE "(?:\\.?" BYTE "){0,7})?|" BYTE "(?:\\.?" BYTE    \
       "){7}_[9A-Fa-f]|#" HEX "(?:\\.?" BYTE "){0,64})"
#define FILTER                                                                                     \
    "(?:~?(?:[0-7]" HEX "{2}|[01]" HEX "{7}|" HEX "{1,8}:" HEX "{1,8})|" HEX "{1,8}~" HEX "{1,8})"
#define FILTERS FILTER "(?:," FILTER "){0,7}"
#define POSITION                                                                                   \
    "sof|srr|ide|rtr|r0|r1|fdf|res|brs|esi|crc-delimiter|ack-slot|ack-slot\\[[01]\\]|"             \
    "ack-delimiter|id\\[(?:1?[0-9]|2[0-8])\\]|dlc\\[[0-3]\\]|"                                     \
    "data\\[(?:[0-9]|[1-5][0-9]|6[0-3])\\.[0-7]\\]|stuff-count\\[[0-3]\\]|"                        \
    "fixed-stuff\\[[0-6]\\]|crc\\[(?:1?[0-9]|20)\\]|eof\\[[0-6]\\]|intermission\\[[0-2]\\]|"       \
    "suspend\\[[0-7]\\]|(?:stuff|bit|error-flag|error-delimiter|overload-flag|"                    \
    "overload-delimiter)\\[(?:[0-9]|[1-9][0-9]|[1-6][0-9]{2}|7[0-5][0-9]|76[0-7])\\]"
#define FIELDS                                                                                     \
    "(?:sof|srr|ide|rtr|r0|r1|fdf|res|brs|esi|crc-delimiter|ack-slot|ack-delimiter|id|dlc|data|"   \
    "stuff-count|fixed-stuff|crc|eof|intermission|suspend|stuff|bit|error-flag|error-delimiter|"   \
    "overload-flag|overload-delimiter)"
#define PORT_NUMBER                                                                                \
    "(?:[1-9][0-9]{0,3}|[1-5][0-9]{4}|6[0-4][0-9]{3}|65[0-4][0-9]{2}|655[0-2][0-9]|6553[0-5])"
#define OCTET "(?:25[0-5]|2[0-4][0-9]|1[0-9]{2}|[1-9]?[0-9])"
#define ADDRESS                                                                                    \
    "(?:localhost|" OCTET "(?:\\." OCTET "){3}|\\[[0-9A-Fa-f.]*:[0-9A-Fa-f:.]*\\])"
#define NOT_OF_MANY                                                                                \
    "(?!(?:22[4-9]|23[0-9])\\.|(?:127|255)\\.255\\.255\\.255(?![0-9])|\\[[Ff][Ff]" BYTE ":)"
#define ENDPOINT NOT_OF_MANY "(?:" PORT_NUMBER "|" ADDRESS "(?::" PORT_NUMBER ")?)"
#define UNIX "unix:[^\\u0000-\\u001F\\u007F]+"
#define PORT                                                                                       \
    "(?:(?!(?:\\.{1,2}|tcp|unix|fd|usb|cannelloni)$)[^/:%\\s]{1,15}|" UNIX                         \
    "|fd:(?:[3-9]|[1-9][0-9]{1,5})|tcp:" ENDPOINT "?(?:/[A-Za-z0-9_.-]{1,32})?|"                   \
    "cannelloni:(?:udp|tcp)(?:,(?:(?:listen|peer|connect)=" ENDPOINT                               \
    "|timeout=(?:0|[0-9.]+(?:ns|us|ms|s))|mtu=(?:[89][0-9]|[1-9][0-9]{2,3}|[1-5][0-9]{4}|"         \
    "6[0-4][0-9]{3}|65[0-4][0-9]{2}|6550[0-7])))+)"
#define FILTER_HELP                                                                                \
    "A filter as can-utils write it: 123, 12345678, ID:MASK, ID~MASK (inverted) or ~ID, "          \
    "separated by commas"

/* A text with this pattern, and further words of JSON schema. */
#define TEXT(pattern) "{'type': ['string', 'number'], 'pattern': '^(?:" pattern ")$'"
/* The same where each number needs a unit, but 0 does not; where no number is one; and for numbers
 * of a range. */
#define QUANTITY(pattern) TEXT(pattern) ", 'minimum': 0, 'maximum': 0"
#define WORD(pattern) "{'type': 'string', 'pattern': '^(?:" pattern ")$'"
#define RANGE(min, max, pattern) TEXT(pattern) ", 'minimum': " #min ", 'maximum': " #max
/* A name may look like anything. */
#define NAME "{'type': ['string', 'number', 'boolean'], 'pattern': '^[A-Za-z0-9_.-]{1,32}$'"
#define HELP(text) ", 'description': '" text "'"
#define EXAMPLES(list) ", 'examples': [" list "]"

static const struct {
    const char *name;
    const char *text;
} types[] = {
    {"parameter", "{'type': 'string', 'pattern': '\\$'"
     HELP("In profiles: $NAME or ${NAME}, a parameter.") "}"},
    {"boolean", "{'enum': [true, false, 'true', 'false', 'on', 'off', 'yes', 'no']}"},
    {"text", "{'type': ['string', 'number', 'boolean'], 'pattern': '.'}"},
    {"name", NAME HELP("1 to 32 letters, digits, ''_'', ''.'' or ''-''.") "}"},
    {"node", NAME HELP("The name of a node.") "}"},
    {"time", QUANTITY(TIME) HELP("A time with unit: ns us ms s min h bit.")
     EXAMPLES("'10ms', '100bit'") "}"},
    {"span", WORD("(?![0.]+(?:[a-z]|$))" TIME) HELP("A time with unit, more than 0.")
     EXAMPLES("'10ms', '100bit'") "}"},
    {"window", QUANTITY(WINDOW) "}"},
    {"frame", WORD(FRAME)
     HELP("A frame as can-utils write it: 123#DEADBEEF, 12345678#, 123#R4, "
          "123#1122334455667788_F; 123##1DEADBEEF is a CAN FD frame, 1 BRS and 2 ESI.") "}"},
    {"filter", TEXT(FILTERS "|#(?![02468ACEace]0{7}$)(?!0+$)" HEX "{1,8}")
     HELP(FILTER_HELP "; or #MASK for error frames.") "}"},
    {"nodeFilter", TEXT(FILTER "(?:," FILTER ")*") HELP(FILTER_HELP ".") "}"},
    {"frameFilter", TEXT(FILTERS) HELP(FILTER_HELP ".") "}"},
    {"wakeOn", TYPE_ANY(TYPE_REF("nodeFilter") ", {'enum': ['off', false]}, "
                        TYPE_LIST(1, 8, TYPE_REF("nodeFilter")))},
    {"position", WORD(POSITION)
     HELP("A bit of the transmitter''s frame; index 0 is on the wire first.")
     EXAMPLES("'crc[3]', 'data[2.7]', 'stuff[1]', 'bit[17]', 'ack-slot', 'brs', 'fixed-stuff[0]'")
     "}"},
    {"positions", "{'type': 'string', 'pattern': '^" FIELDS
     "(?:\\[[0-9]+(?:\\.[0-9]+)?\\]|\\[[0-9]+\\.\\.[0-9]+\\](?:\\.\\*)?|\\.\\*)?$'}"},
    {"fraction", RANGE(0, 1, "0(?:\\.[0-9]+)?|1(?:\\.0+)?|" DECIMAL "[eE][+-]?[0-9]{1,3}")
     HELP("A decimal fraction from 0 to 1.") EXAMPLES("0.05, '1e-5'") "}"},
    {"samplePoint", RANGE(0.1, 0.999, "[1-9][0-9](?:\\.[0-9]0*)?%|0\\.[1-9][0-9]{0,2}") "}"},
    {"length", QUANTITY("0|" DECIMAL "(?:mm|cm|m|km)") HELP("A length with unit, up to 10km.")
     EXAMPLES("'12m'") "}"},
    {"percent", WORD("(?!0(?:\\.0+)?%)(?:100(?:\\.0+)?|[1-9]?[0-9](?:\\.[0-9]0*)?)%")
     EXAMPLES("'60%'") "}"},
    {"data", TEXT("[0-9A-Fa-f.xX]{2}(?: *[0-9A-Fa-f.xX]{2}){0,63}") "}"},
    {"bytes", TEXT(BYTE "(?: *" BYTE "){0,63}") "}"},
    {"id", TEXT(ID) "}"},
    {"line", WORD("wire|[A-Za-z0-9_.-]+\\.(?:tx|rx)") ", 'default': 'wire'}"},
    {"interface", TYPE_TEXT("^(?!\\.{1,2}$)[^/:%\\s]{1,15}$")},
    {"netns", TYPE_TEXT("^(?!\\.)[^/\\s]{1,64}$")},
    {"unixPort", TYPE_TEXT("^" UNIX "$")},
    {"port", TYPE_TEXT("^" PORT "$")},
    {"metricsAddress", "{'type': ['string', 'integer'], 'minimum': 1, 'maximum': 65535, 'pattern': "
     "'^(?:" ENDPOINT "|" UNIX ")$'}"},
    {"clock", TEXT(DECIMAL "(?:|Hz|kHz|MHz|GHz)") ", 'minimum': 0" EXAMPLES("'16MHz'") "}"},
    {"ppm", "{'type': ['integer', 'number', 'string'], "
     "'minimum': -100000, 'maximum': 100000, 'pattern': '^-?(?:0|[1-9][0-9]{0,4}|100000)$'}"},
    {"rawBits", TEXT(" *[01](?: *[01]){0,191} *")
     HELP("Wire bits, at most 192, from the first on: 0 is dominant, 1 recessive.") "}"},
    {"rules", TYPE_LIST_UP_TO(1024, TYPE_REF("rule"))},
    {"parameterValues", "{'type': ['object', 'null'], 'maxProperties': 64, "
     "'propertyNames': {'pattern': '^[A-Za-z][A-Za-z0-9_-]{0,31}$'}, 'additionalProperties': "
     "{'type': ['string', 'number', 'boolean', 'null'], 'minLength': 1, 'maxLength': 256}}"},
    {"nodeSet", TYPE_ANY(TYPE_REF("node") ", " TYPE_SET(64, TYPE_OPEN(TYPE_REF("node"))))},
    {"realTime", "{'type': ['string', 'integer'], 'minimum': 0, 'maximum': 0, "
     "'pattern': '^(0|[0-9]+(\\.[0-9]+)?(ns|us|ms|s|min|h))$'}"},
    {"number", "{'type': ['string', 'integer', 'number'], "
     "'pattern': '^-?[0-9]+(\\.[0-9]+)?[A-Za-z%/]{0,7}$'}"},
};

static const struct {
    schema_reader *read;
    const char *name;
} readers[] = {
    {cfg_read_time, "time"},         {cfg_read_span, "span"},
    {cfg_read_ticks, "time"},        {cfg_read_ticks_min, "span"},
    {cfg_read_bits, "time"},         {cfg_read_bits_min, "span"},
    {cfg_read_period, "span"},       {cfg_read_fine, "time"},
    {cfg_read_fine_min, "span"},     {cfg_read_fraction, "fraction"},
    {cfg_read_frame, "frame"},       {cfg_read_data, "data"},
    {cfg_read_window, "window"},     {cfg_read_position, "position"},
    {cfg_read_node_set, "nodeSet"},  {cfg_read_node_index, "node"},
    {cfg_read_line, "line"},         {cfg_read_sample_point, "samplePoint"},
    {schema_read_bool, "boolean"},
};

/* ---- Words ----------------------------------------------------------------------------------- */

/* Returns word i, NULL behind the last one, "" for none. */
typedef const char *word_getter(unsigned i);

static const char *controller_word(unsigned i)
{
    size_t count;
    const timing_limits *all = timing_controllers(&count);
    return i < count ? all[i].name : NULL;
}

static const char *model_word(unsigned i)
{
    return i < CFG_MODELS ? cfg_model_name((cfg_model)i) : NULL;
}

static const char *state_word(unsigned i)
{
    return i < CW_STATE_COUNT ? cw_state_name((cw_state)i) : NULL;
}

static const char *event_word(unsigned i)
{
    if (i == CW_EVENT_TOLERATED) /* not in event streams */
        return "";
    return i < CW_EVENT_COUNT ? cw_event_name((cw_event_kind)i) : NULL;
}

static const char *error_word(unsigned i)
{
    return i < CW_ERROR_COUNT ? cw_error_type_name((cw_error_type)i) : NULL;
}

static const char *drop_word(unsigned i)
{
    return i < CW_DROP_COUNT ? cw_drop_name((cw_drop)i) : NULL;
}

static const struct {
    const char *name;
    word_getter *get;
} words[] = {
    {"controller", controller_word}, {"model", model_word},     {"state", state_word},
    {"eventKind", event_word},       {"errorType", error_word}, {"drop", drop_word},
};

#define COUNT_OF(array) (sizeof(array) / sizeof((array)[0]))

json_t *type_words(const char *name)
{
    for (size_t i = 0; i < COUNT_OF(words); i++) {
        const char *word;
        if (strcmp(words[i].name, name) != 0)
            continue;
        json_t *list = json_array();
        for (unsigned j = 0; (word = words[i].get(j)) != NULL; j++)
            if (*word)
                json_array_append_new(list, json_string(word));
        return json_pack("{s:o}", "enum", list);
    }
    return NULL;
}

/* ---- Texts ----------------------------------------------------------------------------------- */

const char *type_text(const char *name)
{
    for (size_t i = 0; i < COUNT_OF(types); i++)
        if (strcmp(types[i].name, name) == 0)
            return types[i].text;
    return NULL;
}

const char *type_of_reader(schema_reader *read)
{
    for (size_t i = 0; i < COUNT_OF(readers); i++)
        if (readers[i].read == read)
            return readers[i].name;
    return NULL;
}

/* Returns what a sign stands for, or NULL for itself. Of two apostrophes it passes the first
 * one. */
static const char *expand(const char **text, const char *map)
{
    if (**text == '@')
        return map;
    if (**text == '\\')
        return "\\\\";
    if (**text != '\'')
        return NULL;
    if ((*text)[1] != '\'')
        return "\"";
    ++*text;
    return "'";
}

json_t *type_parse(const char *text, const json_t *map)
{
    char *map_text = map ? json_dumps(map, 0) : NULL;
    json_error_t error;
    memo full;
    FILE *out = memo_begin(&full);
    for (const char *c = text; *c; c++) {
        const char *longer = expand(&c, map_text ? map_text : "@");
        if (longer)
            (void)fputs(longer, out);
        else
            (void)fputc(*c, out);
    }
    json_t *read = json_loads(memo_text(&full), 0, &error);
    if (!read) {
        (void)fprintf(stderr, "%s in %s\n", error.text, full.text);
        exit(EXIT_FAILURE);
    }
    memo_end(&full);
    free(map_text);
    return read;
}
