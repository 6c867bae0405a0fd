/* SPDX-License-Identifier: MIT
 *
 * requests.c - the requests at the control socket.
 *
 * A request is an object with `request`, perhaps `id`, and the keys of the table at the end. Each
 * has a function that fills in the reply or refuses.
 */
#include "serve/requests.h"

#include "base/file/spool.h"
#include "base/text/jsonput.h"
#include "base/text/nearest.h"
#include "base/text/memo.h"
#include "run/settings.h"

#include <errno.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#define KEYS_MAX 3
#define ERROR_TEXT_MAX SETTINGS_ERROR_MAX /* the longest ones name all settings */
#define BUS_KINDS (((1u << CW_EVENT_COUNT) - 1u) & ~(1u << CW_EVENT_TOLERATED))
#define EVERY_KIND (BUS_KINDS | REQUEST_WATCH_RECORD)
#define USUAL_KINDS (EVERY_KIND & ~(1u << CW_EVENT_SYNC) & ~(1u << CW_EVENT_CAPTURE))
#define RECORD_NAME "record"

typedef struct request {
    const request_world *world;
    request_result *result;
    inputs *inputs; /* of the bus, up to now */
    const json_t *asked;
    json_t *reply;
} request;

typedef struct request_key {
    const char *name;
    json_type type;
    bool required;
} request_key;

typedef struct request_kind {
    const char *name;
    bool (*run)(request *r); /* false: refused */
    bool whole_line;         /* may be as long as a line */
    request_key keys[KEYS_MAX + 1];
} request_kind;

/* ---- Replies --------------------------------------------------------------------------------- */

/* Returns false, for the caller to return. */
static bool __attribute__((format(printf, 2, 3)))
requests_refuse(request *r, const char *format, ...)
{
    char text[ERROR_TEXT_MAX];
    va_list args;
    va_start(args, format);
    (void)vsnprintf(text, sizeof text, format, args);
    va_end(args);
    put_text(r->reply, "error", text);
    return false;
}

/* Refuses with a place in the line that the client has sent. Returns false. */
static bool refuse_at(request *r, const char *error, int line, int column)
{
    (void)requests_refuse(r, "%s", error);
    put(r->reply, "line", json_integer(line));
    put(r->reply, "column", json_integer(column));
    return false;
}

/* Puts the numbers of NAME:LINE:COLUMN: message. NAME may contain colons. */
static void put_position(json_t *reply, const char *message)
{
    for (const char *colon = strchr(message, ':'); colon; colon = strchr(colon + 1, ':')) {
        int line, column, length = 0;
        if (sscanf(colon, ":%9d:%9d: %n", &line, &column, &length) == 2 && length > 0) {
            put(reply, "line", json_integer(line));
            put(reply, "column", json_integer(column));
            return;
        }
    }
}

/* Returns a list of the lines of a text. */
static json_t *lines_of(const char *text)
{
    json_t *lines = json_array();
    for (size_t length; *text; text += length + (text[length] == '\n')) {
        length = strcspn(text, "\n");
        put_last(lines, text_to_json(text, length));
    }
    return lines;
}

/* Refuses with the text of a loader, a line per error. */
static bool refuse_lines(request *r, const char *text)
{
    json_t *errors = lines_of(text);
    const char *first = json_string_value(json_array_get(errors, 0));
    (void)requests_refuse(r, "%s", first ? first : "refused without a reason");
    put_position(r->reply, first ? first : "");
    put(r->reply, "errors", errors);
    return false;
}

/* ---- Arguments ------------------------------------------------------------------------------- */

/* Returns NULL for a missing key. */
static const char *requests_text_of(const request *r, const char *key)
{
    return get_text(r->asked, key);
}

/* Finds the node that `node` names. */
static bool requests_find_node(request *r, unsigned *node)
{
    const cfg *config = live_config(r->world->config);
    const char *name = requests_text_of(r, "node");
    nearest guess = {.word = name};
    *node = cfg_find_node(config, name);
    if (*node != CW_NO_NODE)
        return true;
    for (unsigned i = 0; i < config->node_count; i++)
        nearest_consider(&guess, config->nodes[i].name);
    return requests_refuse(r, "there is no node '%.80s'%s%s%s", name,
                           guess.best ? " (did you mean '" : "", guess.best ? guess.best : "",
                           guess.best ? "'?)" : "");
}

/* Finds the rule that `rule` names. */
static bool requests_find_rule(request *r, unsigned *rule)
{
    const char *name = requests_text_of(r, "rule");
    return live_find(r->world->config, rule, name) ||
           requests_refuse(r, "there is no rule '%.80s'", name);
}

/* ---- State ----------------------------------------------------------------------------------- */

/* Answers with the status of the bus, the same that `canwire status` shows. */
static bool run_status(request *r)
{
    report beyond;
    engine_report(r->world->engine, &beyond);
    json_t *status =
        status_json(live_config(r->world->config), r->inputs->bus, &beyond, r->world->errors);
    if (r->world->more)
        r->world->more(r->world->more_user, status);
    put(r->reply, "status", status);
    return true;
}

static bool run_faults(request *r)
{
    put(r->reply, "faults", status_faults(r->world->config, r->inputs->bus));
    return true;
}

/* Returns the kind of events that a word names, or 0. */
static uint32_t kind_of(const char *word)
{
    for (unsigned kind = 0; word && kind < CW_EVENT_COUNT; kind++)
        if ((EVERY_KIND >> kind & 1u) && strcmp(cw_event_name((cw_event_kind)kind), word) == 0)
            return 1u << kind;
    return word && strcmp(word, RECORD_NAME) == 0 ? REQUEST_WATCH_RECORD : 0;
}

/* Returns the names of kinds of events. */
static json_t *kinds_to_json(uint32_t kinds)
{
    json_t *array = json_array();
    for (unsigned kind = 0; kind < CW_EVENT_COUNT; kind++)
        if (kinds >> kind & 1u)
            put_last(array, json_string(cw_event_name((cw_event_kind)kind)));
    if (kinds & REQUEST_WATCH_RECORD)
        put_text_last(array, RECORD_NAME);
    return array;
}

/* Refuses a kind of event that does not exist, with all that do. */
static bool refuse_kind(request *r, const char *word)
{
    json_t *all = kinds_to_json(EVERY_KIND);
    char *list = json_dumps(all, 0);
    (void)requests_refuse(r, "there is no kind of event '%.40s'; there are %s", word ? word : "?",
                          list ? list : "");
    free(list);
    json_decref(all);
    return false;
}

/* Lets the client watch kinds of events, or those that are usual when it names none. */
static bool run_watch(request *r)
{
    const json_t *events = json_object_get(r->asked, "events");
    uint32_t kinds = events ? 0 : USUAL_KINDS;
    for (size_t i = 0; i < json_array_size(events); i++) {
        const char *word = json_string_value(json_array_get(events, i));
        uint32_t kind = kind_of(word);
        if (kind == 0)
            return refuse_kind(r, word);
        kinds |= kind;
    }
    report beyond;
    engine_report(r->world->engine, &beyond);
    *r->result = (request_result){.watch_changed = true, .watch = kinds};
    put(r->reply, "events", kinds_to_json(kinds));
    put_count(r->reply, "epoch_ns", beyond.epoch_ns);
    return true;
}

/* ---- Rules ----------------------------------------------------------------------------------- */

static json_t *names_of(const cfg_rules *rules)
{
    json_t *names = json_array();
    for (size_t i = 0; i < rules->count; i++)
        put_text_last(names, rules->rules[i].name);
    return names;
}

/* Takes rules back that cannot be kept; noted: but are known as such. Returns false. */
static bool refuse_kept(request *r, bool noted, const char *why)
{
    json_t *rules = json_incref(json_object_get(r->reply, "rules"));
    (void)json_object_del(r->reply, "rules");
    for (size_t i = 0; i < json_array_size(rules); i++) {
        const char *name = json_string_value(json_array_get(rules, i));
        unsigned index;
        if (noted)
            (void)kept_take_back(r->world->kept, name);
        if (live_find(r->world->config, &index, name))
            inputs_clear(r->inputs, index);
    }
    json_decref(rules);
    return requests_refuse(r, "the rules cannot be remembered, and are not injected: %s", why);
}

/* Refuses to keep a rule that comes after an injected one which is not kept: no start would take
 * it. */
static bool check_after(request *r)
{
    const live *l = r->world->config;
    const json_t *rules = json_object_get(r->reply, "rules");
    for (size_t i = 0; i < json_array_size(rules); i++) {
        const char *name = json_string_value(json_array_get(rules, i));
        unsigned index;
        if (!live_find(l, &index, name) || !live_config(l)->rules[index].has_after)
            continue;
        const unsigned after = live_config(l)->rules[index].after;
        const char *other = live_config(l)->rules[after].name;
        if (!live_is_injected(l, after) || kept_find(r->world->kept, other) > 0 ||
            json_has_text(rules, other))
            continue;
        char why[ERROR_TEXT_MAX];
        (void)snprintf(why, sizeof why, "'%.80s' comes after '%.80s', which is not kept", name,
                       other);
        return refuse_kept(r, false, why);
    }
    return true;
}

/* Remembers the rules beyond a crash. */
static bool note_injected(request *r, const char *name, bool keep)
{
    kept *k = r->world->kept;
    if (!k)
        return true;
    if (keep && !check_after(r))
        return false;
    r->result->keep = keep;
    r->result->save = kept_note(k, json_object_get(r->asked, "text"), name,
                                json_object_get(r->reply, "rules"), keep);
    return r->result->save > 0 || !keep || refuse_kept(r, true, "see the log");
}

void request_not_cleared(json_t *reply, int error)
{
    request r = {.reply = reply};
    put_bool(reply, "ok", false);
    (void)requests_refuse(&r, "cleared, but the file of injected rules could not be written, and "
                          "the next start reads the old one: %s", spool_explain(error));
}

void request_not_kept(const request_world *world, json_t *reply, int error)
{
    request r = {.world = world, .inputs = engine_change(world->engine), .reply = reply};
    put_bool(reply, "ok", false);
    (void)refuse_kept(&r, true, spool_explain(error));
    (void)kept_save(world->kept);
    engine_update(world->engine);
}

/* Refuses texts that cannot be kept: no place for the file, or too much in it. */
static bool can_keep(request *r, const json_t *text)
{
    if (!r->world->kept)
        return requests_refuse(r,
                               "keep: there is no control socket beside which they could be kept");
    const size_t bytes = kept_bytes(r->world->kept) + json_string_length(text);
    return bytes <= KEPT_BYTES_MAX ||
           requests_refuse(r, "keep: the texts that are kept would have %zu bytes, and at most %u "
                           "are possible: clear rules of others, see `canwire status`", bytes,
                           KEPT_BYTES_MAX);
}

/* Adds the rules of a text to the bus, all or none. With `keep` they outlive a restart. */
static bool run_inject(request *r)
{
    const char *name = requests_text_of(r, "name") ? requests_text_of(r, "name") : "inject";
    const json_t *text = json_object_get(r->asked, "text");
    const bool keep = json_is_true(json_object_get(r->asked, "keep"));
    if (keep && !can_keep(r, text))
        return false;
    memo errors;
    if (!memo_begin(&errors))
        return requests_refuse(r, "out of memory");
    cfg_rules *rules = inputs_inject(r->inputs, json_string_value(text), json_string_length(text),
                                     name, errors.out);
    if (rules)
        put(r->reply, "rules", names_of(rules));
    else
        (void)refuse_lines(r, memo_text(&errors) ? errors.text : "");
    if (rules && *rules->warnings)
        put(r->reply, "warnings", lines_of(rules->warnings));
    const bool none = rules && keep && rules->count == 0;
    if (none)
        (void)requests_refuse(r, "keep: the text has no rules");
    const bool good = rules && !none && note_injected(r, name, keep);
    cfg_free_rules(rules);
    memo_end(&errors);
    return good;
}

/* The name is needed before the rule goes. A kept rule does not come back at the next start. */
static void clear_rule(request *r, json_t *cleared, unsigned index)
{
    const char *name = live_config(r->world->config)->rules[index].name;
    put_text_last(cleared, name);
    if (r->world->kept)
        (void)kept_clear(r->world->kept, name);
    inputs_clear(r->inputs, index);
}

/* Takes away a rule that is kept, but that the bus does not have, since it has refused it. */
static bool clear_refused(request *r)
{
    const char *name = requests_text_of(r, "rule");
    if (!r->world->kept || !kept_clear(r->world->kept, name))
        return false;
    json_t *cleared = json_array();
    put_text_last(cleared, name);
    put(r->reply, "rules", cleared);
    r->result->save = kept_save(r->world->kept);
    r->result->clears = true;
    return true;
}

/* Refuses to clear a kept rule that another one, kept with another text, comes after: no start
 * would take that one. */
static bool is_needed(request *r, unsigned rule)
{
    const cfg *config = live_config(r->world->config);
    const kept *k = r->world->kept;
    const size_t own = k ? kept_find(k, config->rules[rule].name) : 0;
    for (size_t i = 0; own > 0 && i < config->rule_count; i++) {
        const cw_rule *one = &config->rules[i];
        const size_t other = one->name && one->has_after && one->after == rule
                                 ? kept_find(k, one->name) : 0;
        if (other > 0 && other != own)
            return !requests_refuse(r, "rule %.80s: '%.80s', which is kept, comes after it, and no "
                                    "start would take that alone: clear '%.80s' first",
                                    config->rules[rule].name, one->name, one->name);
    }
    return false;
}

/* Clears one rule, or all, or all injected ones. */
static bool run_clear(request *r)
{
    live *config = r->world->config;
    unsigned only = 0;
    bool one = requests_text_of(r, "rule") != NULL;
    bool injected = json_is_true(json_object_get(r->asked, "injected"));
    if (one && injected)
        return requests_refuse(r, "either rule or injected");
    if (one && !live_find(config, &only, requests_text_of(r, "rule")) && clear_refused(r))
        return true;
    if (one && (!requests_find_rule(r, &only) || is_needed(r, only)))
        return false;
    json_t *cleared = json_array();
    for (unsigned i = 0; i < live_config(config)->rule_count; i++)
        if (live_config(config)->rules[i].name && (!one || i == only) &&
            (!injected || live_is_injected(config, i)))
            clear_rule(r, cleared, i);
    if (r->world->kept && !one)
        kept_clear_all(r->world->kept, cleared);
    if (r->world->kept)
        r->result->save = kept_save(r->world->kept);
    r->result->clears = true;
    put(r->reply, "rules", cleared);
    return true;
}

/* Fires a rule by hand, which needs `manual` and a count that is not used up. */
static bool run_fire(request *r)
{
    unsigned index = 0;
    if (!requests_find_rule(r, &index))
        return false;
    bool manual = live_config(r->world->config)->rules[index].manual;
    return inputs_fire(r->inputs, index) == CW_OK ||
           requests_refuse(r, "rule %s: %s", requests_text_of(r, "rule"),
                           manual ? "its count is used up" : "it is not manual");
}

/* ---- Nodes ----------------------------------------------------------------------------------- */

/* Says why a node cannot be restarted. Returns false. */
static bool refuse_restart(request *r, unsigned node)
{
    const char *name = requests_text_of(r, "node");
    cw_node_stats stats = {.state = CW_STATE_ERROR_ACTIVE};
    cw_settings settings = {.which = 0};
    (void)cw_node_get_stats(r->inputs->bus, node, &stats);
    (void)cw_node_get_settings(r->inputs->bus, node, &settings);
    if (stats.state != CW_STATE_BUS_OFF)
        return requests_refuse(r, "node %s: it is not bus-off but %s", name,
                               cw_state_name(stats.state));
    if (settings.restart_ticks != 0)
        return requests_refuse(r, "node %s: it restarts by itself, see restart-ms", name);
    return requests_refuse(r, "node %s: it is restarting already", name);
}

static bool run_restart(request *r)
{
    unsigned node = 0;
    return requests_find_node(r, &node) &&
           (inputs_restart(r->inputs, node) == CW_OK || refuse_restart(r, node));
}

/* Changes settings of a node, and answers with all that it has then. */
static bool run_set(request *r)
{
    unsigned node = 0;
    cw_settings settings = {.which = 0};
    cfg_retime time = {.given = 0};
    char error[SETTINGS_ERROR_MAX], problem[RETIME_PROBLEM_MAX];
    if (!requests_find_node(r, &node))
        return false;
    if (!settings_from_json(&settings, &time, error, json_object_get(r->asked, "settings")))
        return requests_refuse(r, "%s", error);
    if (cfg_stops_schedule(&live_config(r->world->config)->nodes[node], &settings))
        return requests_refuse(r, "node %s: it has a schedule, which needs time-triggered: on",
                               requests_text_of(r, "node"));
    if (inputs_set_all(r->inputs, problem, node, &settings, &time) != CW_OK)
        return requests_refuse(r, "node %s: %s", requests_text_of(r, "node"),
                               *problem ? problem : "the bus does not take these settings");
    (void)cw_node_get_settings(r->inputs->bus, node, &settings);
    time = cfg_retime_present(&live_config(r->world->config)->nodes[node].time);
    put(r->reply, "settings", settings_to_json(&settings));
    put(r->reply, "timing", settings_given_to_json(&(cw_settings){.which = 0}, &time));
    return true;
}

/* ---- Configuration --------------------------------------------------------------------------- */

/* Returns false for the time being: see request_reloaded(). */
static bool run_reload(request *r)
{
    memo errors;
    if (!r->world->reload || !memo_begin(&errors))
        return requests_refuse(r, r->world->reload ? "out of memory" : "there is no reload");
    r->result->round = r->world->reload(r->world->reload_user, errors.out);
    if (r->result->round == 0)
        (void)refuse_lines(r, memo_text(&errors) ? errors.text : "");
    memo_end(&errors);
    return false;
}

void request_reloaded(json_t *reply, const char *errors)
{
    request r = {.reply = reply};
    if (!errors)
        put_bool(reply, "ok", true);
    else
        (void)refuse_lines(&r, errors);
}

/* ---- Parsing --------------------------------------------------------------------------------- */

static const request_kind kinds[] = {
    {"status", run_status, false, {{NULL, JSON_NULL, false}}},
    {"faults", run_faults, false, {{NULL, JSON_NULL, false}}},
    {"inject", run_inject, true,
     {{"text", JSON_STRING, true}, {"name", JSON_STRING, false}, {"keep", JSON_TRUE, false}}},
    {"clear", run_clear, false, {{"rule", JSON_STRING, false}, {"injected", JSON_TRUE, false}}},
    {"fire", run_fire, false, {{"rule", JSON_STRING, true}}},
    {"restart", run_restart, false, {{"node", JSON_STRING, true}}},
    {"set", run_set, false, {{"node", JSON_STRING, true}, {"settings", JSON_OBJECT, true}}},
    {"watch", run_watch, false, {{"events", JSON_ARRAY, false}}},
    {"reload", run_reload, false, {{NULL, JSON_NULL, false}}},
};

#define KINDS (sizeof kinds / sizeof kinds[0])

/* Checks the depth and the number of values of a line without parsing it. Returns the problem, with
 * its place in *at, or NULL. */
static const char *check_shape(const char *line, size_t length, size_t *at)
{
    unsigned depth = 0, values = 0;
    bool in_text = false;
    for (size_t i = 0; i < length; i++) {
        char c = line[i];
        *at = i;
        if (in_text && c == '\\') {
            i++;
        } else if (c == '"') {
            in_text = !in_text;
        } else if (!in_text) {
            bool opens = c == '[' || c == '{';
            depth += opens;
            depth -= (c == ']' || c == '}') && depth > 0;
            values += opens || c == ',' || c == ':';
        }
        if (depth > REQUEST_DEPTH_MAX)
            return "nested too deep";
        if (values > REQUEST_VALUES_MAX)
            return "too many values";
    }
    return NULL;
}

/* Returns the request as an object, or NULL after refusing. */
static json_t *parse(request *r, const char *line, size_t length)
{
    json_error_t error;
    size_t at = 0;
    const char *wrong = check_shape(line, length, &at);
    if (wrong) {
        (void)refuse_at(r, wrong, 1, (int)at + 1);
        return NULL;
    }
    json_t *asked = json_loadb(line, length, JSON_REJECT_DUPLICATES, &error);
    if (!asked)
        (void)refuse_at(r, error.text, error.line, error.column);
    else if (!json_is_object(asked))
        (void)requests_refuse(r, "a request is an object");
    if (json_is_object(asked))
        return asked;
    json_decref(asked);
    return NULL;
}

/* Copies the id to the reply unchanged. */
static bool take_id(request *r)
{
    json_t *id = json_object_get(r->asked, "id");
    if (id && !json_is_string(id) && !json_is_integer(id))
        return requests_refuse(r, "id: expected a text or a whole number");
    if (id)
        put(r->reply, "id", json_incref(id));
    return true;
}

/* Finds what is asked for. Refuses other names, with a guess. */
static const request_kind *requests_find_kind(request *r)
{
    const char *name = requests_text_of(r, "request");
    nearest guess = {.word = name};
    for (size_t i = 0; name && i < KINDS; i++) {
        if (strcmp(kinds[i].name, name) == 0)
            return &kinds[i];
        nearest_consider(&guess, kinds[i].name);
    }
    if (!name)
        (void)requests_refuse(r, "request: expected a text, the name of the request");
    else
        (void)requests_refuse(r, "there is no request '%.40s'%s%s%s", name,
                              guess.best ? " (did you mean '" : "", guess.best ? guess.best : "",
                              guess.best ? "'?)" : "");
    return NULL;
}

static const request_key *requests_find_key(const request_kind *kind, const char *name)
{
    for (const request_key *key = kind->keys; key->name; key++)
        if (strcmp(key->name, name) == 0)
            return key;
    return NULL;
}

/* Checks the type of a value; JSON_TRUE stands for both truth values. */
static bool has_type(const json_t *value, json_type type)
{
    return json_typeof(value) == type || (type == JSON_TRUE && json_is_false(value));
}

/* Refuses keys that such a request does not have, that are missing, or of a wrong type. */
static bool requests_check_keys(request *r, const request_kind *kind)
{
    static const char *const types[] = {[JSON_OBJECT] = "an object",
                                        [JSON_ARRAY] = "a list",
                                        [JSON_STRING] = "a text",
                                        [JSON_TRUE] = "true or false"};
    json_t *members = (json_t *)(uintptr_t)r->asked; /* the iterator does not accept a const
                                                        object */
    for (void *i = json_object_iter(members); i; i = json_object_iter_next(members, i)) {
        const char *name = json_object_iter_key(i);
        const request_key *key = requests_find_key(kind, name);
        if (strcmp(name, "id") == 0 || strcmp(name, "request") == 0)
            continue;
        if (!key)
            return requests_refuse(r, "%s: there is no key '%.40s'", kind->name, name);
        if (!has_type(json_object_iter_value(i), key->type))
            return requests_refuse(r, "%s: expected %s", name, types[key->type]);
    }
    for (const request_key *key = kind->keys; key->name; key++)
        if (key->required && !json_object_get(r->asked, key->name))
            return requests_refuse(r, "%s: the key '%s' is missing", kind->name, key->name);
    return true;
}

/* Carries out a request at the present tick of the bus: what is due before it comes first. */
static bool requests_run(request *r, size_t length)
{
    const request_kind *kind = take_id(r) ? requests_find_kind(r) : NULL;
    if (!kind)
        return false;
    if (length > REQUEST_BYTES_MAX && !kind->whole_line)
        return requests_refuse(r, "%s: longer than %u bytes", kind->name, REQUEST_BYTES_MAX);
    if (!requests_check_keys(r, kind))
        return false;
    r->inputs = engine_change(r->world->engine);
    bool good = kind->run(r);
    engine_update(r->world->engine);
    return good;
}

json_t *request_answer(const request_world *world, request_result *result, const char *line,
                       size_t length)
{
    request r = {.world = world, .result = result, .reply = json_object()};
    put_bool(r.reply, "ok", false); /* keeps its place at the beginning of the reply */
    json_t *asked = parse(&r, line, length);
    r.asked = asked;
    if (asked)
        put_bool(r.reply, "ok", requests_run(&r, length));
    json_decref(asked);
    return r.reply;
}
