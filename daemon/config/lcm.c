/* SPDX-License-Identifier: MIT
 *
 * lcm.c - the keys of `lcm`: the messages that are published, and their address.
 */
#include "config/parts.h"

#include "config/values.h"

#include <regex.h>

#define LCM_EVENTS_MAX 64u   /* words in one list */
#define LCM_URL_DEFAULT "udpm://239.255.76.67:7667?ttl=0"

/* Of liblcm's URLs, also for the schema. liblcm itself takes another text for a network that is not
 * there yet. */
#define OCTET "(25[0-5]|2[0-4][0-9]|1[0-9][0-9]|[1-9]?[0-9])"
#define PORT                                                                                       \
    "(:(6553[0-5]|655[0-2][0-9]|65[0-4][0-9]{2}|6[0-4][0-9]{3}|[1-5][0-9]{4}|[1-9][0-9]{0,3}))?"
#define OPTION "[a-z_]+=[0-9]+"
#define OPTIONS "([?]" OPTION "(&" OPTION ")*)?"
#define MULTICAST "(mp)?udpm://((22[4-9]|23[0-9])([.]" OCTET "){3}" PORT ")?" OPTIONS
#define SERVER "tcpq://([A-Za-z0-9._-]+" PORT ")?"
#define LCM_URL "^(" MULTICAST "|" SERVER "|file://[^?]+[?]mode=w|memq://)$"

static schema_reader read_lcm_url, read_lcm_events;

const schema_key cfg_lcm_keys[] = {
    {.name = "url", .read = read_lcm_url, .type = "{'type': 'string', 'pattern': '" LCM_URL "'}",
     .preset = LCM_URL_DEFAULT,
     .help = "LCM provider; ttl=0 is this host only."},
    {.name = "period", .read = cfg_read_span, .offset = offsetof(cfg_lcm, period), .preset = "1s",
     .help = "Of the statistics."},
    {.name = "events", .read = read_lcm_events,
     .type = TYPE_ANY(TYPE_REF("eventKind") ", " TYPE_LIST_UP_TO(64, TYPE_REF("eventKind"))),
     .preset = "['error', 'state', 'restart', 'overload', 'drop', 'fault']",
     .help = "Kinds of events that are published."},
    {.name = NULL},
};

/* The key alone is enough to publish, with the defaults of its own keys. */
void cfg_read_lcm(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg *config = object;

    config->lcm = (cfg_lcm){.enabled = true, .place = cfg_place_of(value)};
    schema_read_presets(self, cfg_lcm_keys, &config->lcm);
    config->lcm.url_place = config->lcm.place;
    schema_map(self, key->name, value, cfg_lcm_keys, &config->lcm);
}

/* Returns true for a URL that liblcm can use. Without memory that is for liblcm to say. */
static bool is_url(const char *text)
{
    regex_t url;
    if (regcomp(&url, LCM_URL, REG_EXTENDED | REG_NOSUB) != 0)
        return true;
    const bool good = regexec(&url, text, 0, NULL, 0) == 0;
    regfree(&url);
    return good;
}

static void read_lcm_url(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const char expected[] = "an LCM URL: udpm://ADDRESS:PORT?ttl=N with a multicast "
                                   "address, tcpq://HOST:PORT, or file://PATH?mode=w";
    cfg_lcm *lcm = object;
    const char *text = schema_text(self, key, value, expected);

    lcm->url_place = cfg_place_of(value);
    if (text && !is_url(text))
        schema_expected(self, key, value, expected);
    if (text)
        lcm->url = schema_copy(self, text);
}

/* Returns the kinds of events that one word stands for, as bits; 0 after a complaint. */
static uint32_t read_event_kind(schema *self, const schema_key *key, const yaml_node_t *value)
{
    schema_choice choices[CW_EVENT_COUNT + 1] = {{.name = NULL}};
    size_t count = 0;
    unsigned kind;

    for (unsigned i = 0; i < CW_EVENT_COUNT; i++)
        if (i != CW_EVENT_TOLERATED) /* not in event streams */
            choices[count++] = (schema_choice){.name = cw_event_name((cw_event_kind)i), .value = i};
    return schema_choose(self, &kind, key, value, choices) ? 1u << kind : 0;
}

/* A list replaces the default kinds; an empty one publishes statistics alone. */
static void read_lcm_events(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_lcm *lcm = object;
    size_t count = schema_count_one(self, key, value, 0, LCM_EVENTS_MAX);

    lcm->events = 0;
    for (size_t i = 0; i < count; i++)
        lcm->events |= read_event_kind(self, key, schema_item(self, value, i));
}
