/* SPDX-License-Identifier: MIT
 *
 * test_requests.c - requests at the control socket: status, rules, settings, reload, and what is
 * not understood.
 */
#include "cases.h"
#include "base/text/yamlfile.h"
#include "control_rig.h"
#include "serve/requests.h"
#include "serve/server.h"
#include "serve/status.h"

#include <dlfcn.h>
#include <yaml.h>

/* ---- What is read of texts ------------------------------------------------------------------- */

static struct {
    size_t yaml_characters;
    size_t yaml_events;
    size_t yaml_nodes; /* that were looked at */
} work;

/* Counts the work of libyaml on the texts of rules. */
int yaml_parser_parse(yaml_parser_t *parser, yaml_event_t *event)
{
    static int (*real)(yaml_parser_t *, yaml_event_t *);
    if (!real)
        *(void **)&real = dlsym(RTLD_NEXT, "yaml_parser_parse");
    size_t before = parser->mark.index;
    int good = real(parser, event);
    work.yaml_characters += parser->mark.index - before;
    work.yaml_events++;
    return good;
}

yaml_node_t *yaml_document_get_node(yaml_document_t *document, int index)
{
    static yaml_node_t *(*real)(yaml_document_t *, int);
    if (!real)
        *(void **)&real = dlsym(RTLD_NEXT, "yaml_document_get_node");
    work.yaml_nodes++;
    return real(document, index);
}

#define TEXT_MAX (1u << 16)

/* Asks what must be refused, with these words in the error. */
static void expect_refusal(const rig *r, int fd, const char *request, const char *words)
{
    json_auto_t *reply = ask(r, fd, request);
    const char *error = text(reply, "error");
    if (!json_is_false(json_object_get(reply, "ok")) || !error || !strstr(error, words))
        fail_msg("%.100s: expected \"%s\", got \"%s\"", request, words, error ? error : "no error");
}

/* ---- Requests -------------------------------------------------------------------------------- */

static void put_bus_off(engine *e, unsigned node)
{
    const cw_rule rule = {.name = "off",
                          .trigger = CW_TRIGGER_TIME,
                          .time_end = CW_NEVER,
                          .probability = UINT64_MAX,
                          .action = CW_ACTION_BUS_OFF,
                          .nodes = UINT64_C(1) << node};
    unsigned index = 0;
    assert_int_equal(cw_bus_add_rule(e->bus, &index, &rule), CW_OK);
    engine_update(e);
    assert_int_equal(cw_bus_clear_rule(e->bus, index), CW_OK);
}

CASE(id_goes_back)
{
    const rig *r = *state;
    int fd = connect_client(r);
    json_auto_t *reply = grant(r, fd, "{\"id\":42,\"request\":\"faults\"}");
    assert_int_equal(number(reply, "id"), 42);
    json_decref(reply);
    reply = ask(r, fd, "{\"id\":\"x\",\"request\":\"nothing\"}");
    assert_string_equal(text(reply, "id"), "x");
    assert_false(is_on(reply, "ok"));
    json_decref(reply);
    reply = grant(r, fd, "{\"request\":\"faults\"}");
    assert_null(json_object_get(reply, "id"));
    close(fd);
}

CASE(status_tells_of_bus_and_nodes)
{
    rig *r = *state;
    const cw_frame frame = {.id = 0x123, .dlc = 2};
    int fd = connect_client(r);
    cw_node_send(r->engine.bus, 0, &frame, 0);
    json_auto_t *reply = grant(r, fd, "{\"request\":\"status\"}");
    const json_t *status = json_object_get(reply, "status");
    const json_t *bus = json_object_get(status, "bus");
    const json_t *nodes = json_object_get(status, "nodes");
    assert_string_equal(text(bus, "name"), "test");
    assert_int_equal(number(bus, "bitrate"), 500000);
    assert_int_equal(number(bus, "frames"), 1);
    assert_int_equal(json_array_size(nodes), 3);
    const json_t *a = json_array_get(nodes, 0);
    assert_string_equal(text(a, "name"), "a");
    assert_string_equal(text(a, "state"), "error-active");
    assert_int_equal(number(a, "tx_frames"), 1);
    assert_int_equal(number(json_object_get(a, "settings"), "warning-limit"), 90);
    assert_true(json_is_null(json_object_get(a, "interface")));
    const json_t *c = json_array_get(nodes, 2);
    assert_int_equal(number(c, "rx_frames"), 1);
    assert_int_equal(number(json_object_get(c, "settings"), "restart-ms"), 100);
    close(fd);
}

/* Prints the status in a reply, as the tool does. */
static void print_status(char out[TEXT_MAX], const json_t *reply)
{
    FILE *file = fmemopen(out, TEXT_MAX, "w");
    status_print(file, json_object_get(reply, "status"));
    fclose(file);
}

/* Checks the output of `canwire status`, in the layout of iproute2. */
CASE(status_prints_as_ip_does)
{
    rig *r = *state;
    char printed[TEXT_MAX] = "";
    int fd = connect_client(r);
    tell(r, fd,
         "{\"request\":\"set\",\"node\":\"b\","
         "\"settings\":{\"listen-only\":true,\"one-shot\":true}}");
    json_t *reply = grant(r, fd, "{\"request\":\"status\"}");
    print_status(printed, reply);
    json_decref(reply);
    close(fd);
    assert_non_null(strstr(printed, "test: bitrate 500000 up 0."));
    assert_non_null(strstr(printed, "\n3: c: qlen 16 order priority\n"
                                    "    can state ERROR-ACTIVE (berr-counter tx 0 rx 0) "
                                    "restart-ms 100\n"
                                    "\t  bitrate 500000 sample-point 0.875 warning-limit 96\n"
                                    "\t  tq 125 prop-seg 6 phase-seg1 7 phase-seg2 2 sjw 1 "
                                    "brp 10\n"
                                    "\t  clock 80000000\n"
                                    "\t  re-started "));
    assert_non_null(strstr(printed, "    can <LISTEN-ONLY,ONE-SHOT> state ERROR-ACTIVE ("));
    assert_non_null(strstr(printed, "\n\t  re-started bus-errors arbit-lost error-warn error-pass "
                                    "bus-off\n"
                                    "\t  0          0          0          0          0          "
                                    "0\n"));
    assert_non_null(strstr(printed, "\n    RX:  bytes packets errors dropped  missed   mcast\n"
                                    "             0       0      0       0       0       0\n"
                                    "    TX:  bytes packets errors dropped carrier collsns\n"));
}

/* Missing members must not end the tool. */
CASE(status_prints_what_is_no_status)
{
    char printed[TEXT_MAX] = "";
    json_auto_t *odd = json_loads("{\"bus\":7,\"nodes\":[{},3,null]}", 0, NULL);
    FILE *out = fmemopen(printed, sizeof printed, "w");
    status_print(out, odd);
    status_print(out, NULL);
    status_print_faults(out, odd);
    fclose(out);
}

static const char manual_rule[] =
    "{\"request\":\"inject\",\"text\":\"- {name: by-hand, when: {manual: yes}, "
    "do: {counters: b, tec: 100}}\\n"
    "- {name: then, when: {after: {rule: by-hand, delay: 1bit}}, do: {bus-off: a}}\"}";

CASE(rules_are_injected_fired_and_cleared)
{
    rig *r = *state;
    int fd = connect_client(r);
    json_t *reply = grant(r, fd, manual_rule);
    assert_int_equal(json_array_size(json_object_get(reply, "rules")), 2);
    json_decref(reply);
    tell(r, fd, "{\"request\":\"fire\",\"rule\":\"by-hand\"}");
    reply = grant(r, fd, "{\"request\":\"faults\"}");
    const json_t *faults = json_object_get(reply, "faults");
    assert_int_equal(json_array_size(faults), 3);
    assert_false(is_on(json_array_get(faults, 0), "injected"));
    const json_t *by_hand = json_array_get(faults, 1);
    assert_string_equal(text(by_hand, "name"), "by-hand");
    assert_string_equal(text(by_hand, "action"), "counters");
    assert_int_equal(number(by_hand, "hits"), 1);
    assert_true(is_on(by_hand, "manual") && is_on(by_hand, "injected"));
    assert_int_equal(number(json_array_get(faults, 2), "hits"), 1);
    json_decref(reply);
    cw_node_stats stats;
    cw_node_get_stats(r->engine.bus, 0, &stats);
    assert_int_equal(stats.state, CW_STATE_BUS_OFF);
    expect_refusal(r, fd, "{\"request\":\"fire\",\"rule\":\"configured\"}", "not manual");
    expect_refusal(r, fd, manual_rule, "by-hand"); /* the name is taken */
    tell(r, fd, "{\"request\":\"clear\",\"rule\":\"by-hand\"}");
    expect_refusal(r, fd, "{\"request\":\"clear\",\"rule\":\"by-hand\"}", "no rule 'by-hand'");
    tell(r, fd, "{\"request\":\"clear\",\"injected\":true}");
    reply = grant(r, fd, "{\"request\":\"clear\"}");
    assert_int_equal(json_array_size(json_object_get(reply, "rules")), 1);
    json_decref(reply);
    tell(r, fd, manual_rule); /* name and place are free again */
    close(fd);
}

CASE(bad_rules_are_refused_with_their_place)
{
    rig *r = *state;
    int fd = connect_client(r);
    json_t *reply = ask(r, fd,
                        "{\"request\":\"inject\",\"name\":\"x:y.yaml\",\"text\":"
                        "\"- {name: good, when: {frame: \\\"123\\\"}, do: {flip: sof}}\\n"
                        "- {name: bad, do: {bus-off: nobody}}\\n\"}");
    assert_false(is_on(reply, "ok"));
    assert_int_equal(number(reply, "line"), 2);
    assert_true(number(reply, "column") > 10);
    const char *first = json_string_value(json_array_get(json_object_get(reply, "errors"), 0));
    assert_string_equal(first, text(reply, "error"));
    assert_memory_equal(first, "x:y.yaml:2:", strlen("x:y.yaml:2:"));
    json_decref(reply);
    assert_int_equal(live_config(r->live)->rule_count, 1); /* not the good one either */
    close(fd);
}

CASE(a_full_bus_takes_no_rules)
{
    rig *r = *state;
    int fd = connect_client(r);
    for (unsigned i = 0; i + 2 < CW_RULES_MAX; i++) {
        char request[200];
        snprintf(request, sizeof request,
                 "{\"request\":\"inject\",\"text\":\"- {name: r%u, when: {frame: \\\"123\\\"}, "
                 "do: {flip: sof}}\"}",
                 i);
        tell(r, fd, request);
    }
    expect_refusal(r, fd, manual_rule, "no more room"); /* there is for one of two */
    assert_int_equal(live_config(r->live)->rule_count, CW_RULES_MAX - 1);
    tell(r, fd, "{\"request\":\"clear\",\"rule\":\"r7\"}");
    tell(r, fd, manual_rule);
    assert_int_equal(live_config(r->live)->rule_count, CW_RULES_MAX);
    json_decref(grant(r, fd, "{\"request\":\"faults\"}")); /* the longest reply */
    close(fd);
}

CASE(nodes_are_restarted)
{
    rig *r = *state;
    int fd = connect_client(r);
    expect_refusal(r, fd, "{\"request\":\"restart\",\"node\":\"a\"}",
                   "not bus-off but error-active");
    put_bus_off(&r->engine, 0);
    put_bus_off(&r->engine, 2);
    tell(r, fd, "{\"request\":\"restart\",\"node\":\"a\"}");
    expect_refusal(r, fd, "{\"request\":\"restart\",\"node\":\"c\"}", "by itself");
    expect_refusal(r, fd, "{\"request\":\"restart\",\"node\":\"d\"}", "no node 'd'");
    close(fd);
}

CASE(settings_are_changed)
{
    rig *r = *state;
    int fd = connect_client(r);
    json_auto_t *reply = grant(
        r, fd,
        "{\"request\":\"set\",\"node\":\"a\",\"settings\":{\"one-shot\":true,"
        "\"berr-reporting\":\"on\",\"restricted\":true,\"lost-arbitration-reporting\":true,"
        "\"restart-ms\":\"250\",\"queue\":3,\"order\":\"fifo\",\"warning-limit\":255}}");
    const json_t *now = json_object_get(reply, "settings");
    assert_true(is_on(now, "one-shot") && is_on(now, "berr-reporting"));
    assert_true(is_on(now, "lost-arbitration-reporting"));
    assert_false(is_on(now, "loopback"));
    assert_true(is_on(now, "restricted"));
    assert_int_equal(number(now, "restart-ms"), 250);
    assert_int_equal(number(now, "queue"), 3);
    assert_string_equal(text(now, "order"), "fifo");
    assert_int_equal(number(now, "warning-limit"), 255);
    json_decref(reply);
    reply =
        grant(r, fd, "{\"request\":\"set\",\"node\":\"a\",\"settings\":{\"one-shot\":\"off\"}}");
    now = json_object_get(reply, "settings");
    assert_false(is_on(now, "one-shot"));
    assert_true(is_on(now, "berr-reporting"));
    close(fd);
}

CASE(reload_tells_errors)
{
    rig *r = *state;
    int fd = connect_client(r);
    tell(r, fd, "{\"request\":\"reload\"}");
    r->engine.reload_errors = "bus.yaml:7:3: first\nbus.yaml:9:1: second\n";
    json_auto_t *reply = ask(r, fd, "{\"request\":\"reload\"}");
    assert_int_equal(number(reply, "line"), 7);
    assert_int_equal(number(reply, "column"), 3);
    assert_int_equal(json_array_size(json_object_get(reply, "errors")), 2);
    close(fd);
}

/* Each gets the outcome of the round in which its reload was, and all others go on meanwhile. */
CASE(a_reload_that_takes_long_holds_up_nobody_else)
{
    rig *r = *state;
    int first = connect_client(r);
    int second = connect_client(r);
    int third = connect_client(r);
    static const char asked[] = "{\"request\":\"reload\",\"id\":7}\n{\"request\":\"faults\"}\n";
    r->reloads_take_long = true;
    assert_true(send_bytes(r, first, asked, sizeof asked - 1));
    turns(r, 10);
    assert_true(send_bytes(r, second, asked, sizeof asked - 1));
    assert_true(send_bytes(r, third, asked, sizeof asked - 1));
    turns(r, 10);
    assert_int_equal(r->engine.reloads, 3);
    close(third);
    int fourth = connect_client(r);
    tell(r, fourth, "{\"request\":\"faults\"}");
    close(fourth);
    control_reloaded(r->control, 2, NULL);
    json_t *reply = next_json(r, second);
    assert_true(is_on(reply, "ok"));
    assert_int_equal(number(reply, "id"), 7);
    json_decref(reply);
    reply = next_json(r, second);
    assert_non_null(json_object_get(reply, "faults"));
    json_decref(reply);
    control_reloaded(r->control, 1, "bus.yaml:7:3: first\n");
    reply = next_json(r, first);
    assert_false(is_on(reply, "ok"));
    assert_int_equal(number(reply, "line"), 7);
    json_decref(reply);
    control_reloaded(r->control, 3, NULL); /* no client waits for it any more */
    close(first);
    close(second);
    turns(r, 10);
}

/* ---- What is not understood ------------------------------------------------------------------ */

typedef struct refusal {
    const char *request;
    const char *words; /* of the error */
    bool placed;       /* the error has a position */
} refusal;

static const refusal refusals[] = {
    {"{", "'}' expected", true},
    {"x", "'[' or '{' expected", true},
    {"{\"request\":\"status\"} x", "end of file expected", true},
    {"[]", "object", false},
    {"3", "expected", true},
    {"{}", "request: expected a text", false},
    {"{\"request\":7}", "request: expected a text", false},
    {"{\"request\":\"sttus\"}", "did you mean 'status'", false},
    {"{\"request\":\"\"}", "no request ''", false},
    {"{\"request\":\"status\",\"id\":null}", "id: expected", false},
    {"{\"request\":\"status\",\"id\":[1]}", "id: expected", false},
    {"{\"request\":\"status\",\"node\":\"a\"}", "no key 'node'", false},
    {"{\"request\":\"status\",\"request\":\"clear\"}", "duplicate", true},
    {"{\"request\":\"restart\"}", "key 'node' is missing", false},
    {"{\"request\":\"restart\",\"node\":1}", "node: expected a text", false},
    {"{\"request\":\"restart\",\"node\":\"\xff\"}", "unable to decode byte", true},
    {"{\"request\":\"restart\",\"node\":\"a\\u0000b\"}", "\\u0000", false},
    {"{\"request\":\"clear\",\"injected\":1}", "true or false", false},
    {"{\"request\":\"clear\",\"injected\":true,\"rule\":\"x\"}", "either", false},
    {"{\"request\":\"set\",\"node\":\"a\",\"settings\":[]}", "settings: expected an object", false},
    {"{\"request\":\"set\",\"node\":\"a\",\"settings\":{}}", "no settings", false},
    {"{\"request\":\"set\",\"node\":\"a\",\"settings\":{\"queue\":0}}", "from 1 to 4096", false},
    {"{\"request\":\"set\",\"node\":\"a\",\"settings\":{\"queue\":-1}}", "from 1 to 4096", false},
    {"{\"request\":\"set\",\"node\":\"a\",\"settings\":{\"queue\":1.5}}", "from 1 to 4096", false},
    {"{\"request\":\"set\",\"node\":\"a\",\"settings\":{\"queue\":\"1k\"}}",
     "from 1 to 4096, write 1000", false},
    {"{\"request\":\"set\",\"node\":\"a\",\"settings\":{\"order\":\"lifo\"}}", "priority or fifo",
     false},
    {"{\"request\":\"set\",\"node\":\"a\",\"settings\":{\"loopback\":1}}", "on or off", false},
    {"{\"request\":\"set\",\"node\":\"a\",\"settings\":{\"restart\":1}}", "restart-ms", false},
    {"{\"request\":\"set\",\"node\":\"a\",\"settings\":{\"q\":1}}", "there are loopback", false},
    {"{\"request\":\"set\",\"node\":\"a\",\"settings\":{\"when-full\":\"wait\"}}",
     "when-full: change it in the configuration and reload", false},
    {"{\"request\":\"watch\",\"events\":[\"txx\"]}", "kind of event 'txx'", false},
    {"{\"request\":\"watch\",\"events\":[\"tolerated\"]}", "kind of event", false},
    {"{\"request\":\"watch\",\"events\":[7]}", "kind of event", false},
    {"{\"request\":\"inject\",\"text\":\"\"}", "", false},
    {"[[[[[[[[[[]]]]]]]]]]", "nested too deep", true},
    {"{\"a\":99999999999999999999}", "too big integer", true},
};

CASE(what_is_not_understood_is_refused)
{
    const rig *r = *state;
    int fd = connect_client(r);
    for (size_t i = 0; i < sizeof refusals / sizeof refusals[0]; i++) {
        const refusal *row = &refusals[i];
        expect_refusal(r, fd, row->request, row->words);
        json_auto_t *reply = ask(r, fd, row->request);
        if (row->placed && (number(reply, "line") != 1 || number(reply, "column") < 1))
            fail_msg("%s: no place", row->request);
    }
    tell(r, fd, "{\"request\":\"status\"}"); /* the connection is good for more */
    close(fd);
}

/* ---- Sizes ----------------------------------------------------------------------------------- */

/* Returns a request of this length; `filler` stands between head and tail. */
static char *make_request(const char *head, char filler, const char *tail, size_t length)
{
    char *line = malloc(length + 1);
    memset(line, filler, length);
    memcpy(line, head, strlen(head));
    strcpy(line + length - strlen(tail), tail);
    return line;
}

CASE(only_inject_may_be_long)
{
    const rig *r = *state;
    int fd = connect_client(r);
    FREED char *line = make_request("{\"request\":\"status\"", ' ', "}", REQUEST_BYTES_MAX + 1);
    expect_refusal(r, fd, line, "longer than 65536 bytes");
    free(line);
    line = make_request("{\"request\":\"status\"", ' ', "}", REQUEST_BYTES_MAX);
    tell(r, fd, line);
    free(line);
    line =
        make_request("{\"request\":\"inject\",\"text\":\"[{name: long, when: {frame: \\\"123\\\"}, "
                     "do: {flip: sof}}]",
                     ' ', "\"}", SERVER_LINE_MAX);
    tell(r, fd, line);
    close(fd);
}

CASE(deep_and_wide_requests_are_refused)
{
    const rig *r = *state;
    int fd = connect_client(r);
    static const char fillers[] = "[{\",:";
    for (const char *filler = fillers; *filler; filler++) {
        FREED char *line = make_request("{\"a\":", *filler, "}", SERVER_LINE_MAX);
        expect_refusal(r, fd, line, "");
    }
    FREED char *line =
        make_request("{\"request\":\"status\",\"a\":[0", ',', "]}", REQUEST_BYTES_MAX);
    expect_refusal(r, fd, line, "too many values");
    close(fd);
}

/* A text of rules is read while the bus waits: not again and again, and not more than rules need.
 */
CASE(a_text_of_rules_makes_little_work)
{
    const rig *r = *state;
    static const char *const heads[] = {"- [", "- '"};
    static const char *const tails[] = {"]", "'"};
    int fd = connect_client(r);
    for (unsigned i = 0; i < 2; i++) {
        char head[100], tail[1000];
        snprintf(head, sizeof head, "{\"request\":\"inject\",\"text\":\"%s", heads[i]);
        int at = snprintf(tail, sizeof tail, "%s\\n- [", tails[i]);
        for (unsigned k = 0; k <= 20; k++) /* each is mended, and the text read again */
            at += snprintf(tail + at, sizeof tail - (size_t)at, "{flip: crc[3]},");
        snprintf(tail + at, sizeof tail - (size_t)at, "]\"}");
        FREED char *line = make_request(head, ',', tail, SERVER_LINE_MAX);
        for (size_t k = strlen(head); i == 0 && k < 2 * (YAML_TEXT_NODES_MAX - 100); k += 2)
            line[k] = '1';
        work.yaml_characters = work.yaml_events = 0;
        expect_refusal(r, fd, line, "inject:");
        assert_in_range(work.yaml_characters, SERVER_LINE_MAX / 8, 3 * SERVER_LINE_MAX);
        assert_in_range(work.yaml_events, 1, 3 * YAML_TEXT_NODES_MAX);
    }
    close(fd);
}

/* Writes a text so many times, each with its number; returns the end. */
static char *add_times(char *at, unsigned count, const char *format)
{
    for (unsigned i = 0; i < count; i++)
        at += sprintf(at, format, i);
    return at;
}

/* A part that many rules share is read for each of them, but not when it is wrong. */
CASE(aliases_of_what_is_wrong_make_little_work)
{
    static const struct {
        unsigned keys;
        const char *head;
        const char *rule;
        const char *words;
    } cases[] = {
        {199, "- {name: a, do: &d {", "- {name: a%u, do: *d}\\n", "unknown key 'k0'"},
        {7000, "- {name: a, do: &d {", "- {name: a%u, do: *d}\\n", "unknown key 'k0'"},
        {7000, "- {name: a, do: &d {flip: sof, drop: tx, ", "- {name: a%u, do: *d}\\n",
         "one action"},
        {7000, "- {name: a, do: {flip: sof}, when: &d {", "- {name: a%u, when: *d}\\n",
         "unknown key 'k0'"},
    };
    const rig *r = *state;
    int fd = connect_client(r);
    for (unsigned i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        FREED char *line = malloc(SERVER_LINE_MAX);
        char *at = line + sprintf(line, "{\"request\":\"inject\",\"text\":\"%s", cases[i].head);
        at = add_times(at, cases[i].keys, "k%u: 1, ");
        at += sprintf(at, "}}\\n");
        at = add_times(at, 1000, cases[i].rule);
        sprintf(at, "\"}");
        work.yaml_nodes = 0;
        expect_refusal(r, fd, line, cases[i].words);
        assert_in_range(work.yaml_nodes, 1, 30 * YAML_TEXT_NODES_MAX);
    }
    close(fd);
}

/* Nor is a long text that many name. */
CASE(a_text_with_an_anchor_is_short)
{
    const rig *r = *state;
    int fd = connect_client(r);
    FREED char *line = make_request("{\"request\":\"inject\",\"text\":\"- &a '", '0', "'\"}",
                                    YAML_ANCHORED_MAX + 100);
    expect_refusal(r, fd, line, "inject:1:3: a text with an anchor has at most 4096 bytes");
    close(fd);
}

/* A node with a schedule, of a controller with mailboxes, and one that sleeps. */
static int set_up_scheduled(void **state)
{
    return set_up_with(state,
                       "bus: { name: test, bitrate: 500000 }\n"
                       "nodes:\n"
                       "  - name: a\n"
                       "    time-triggered: on\n"
                       "    local-time: {}\n"
                       "    controller: { model: full }\n"
                       "    schedule: { reference: \"010\", triggers: [ { at: 60000, slot: 100, "
                       "send: 010# } ] }\n"
                       "  - { name: b, wake-time: 2ms, wake-on: \"500:7F0\" }\n");
}

TEST_WITH(a_schedule_needs_its_mode, set_up_scheduled, tear_down)
{
    const rig *r = *state;
    int fd = connect_client(r);
    expect_refusal(r, fd,
                   "{\"request\":\"set\",\"node\":\"a\","
                   "\"settings\":{\"time-triggered\":\"off\"}}",
                   "node a: it has a schedule, which needs time-triggered: on");
    expect_refusal(r, fd,
                   "{\"request\":\"inject\",\"text\":\"{name: x, when: {time: 1s}, "
                   "do: {set: [a, b], time-triggered: off}}\"}",
                   "inject:1:63: time-triggered: node 'a' has a schedule, which needs it");
    json_t *reply = grant(r, fd,
                          "{\"request\":\"set\",\"node\":\"a\",\"settings\":{"
                          "\"time-triggered\":true,\"one-shot\":true}}");
    assert_true(is_on(json_object_get(reply, "settings"), "time-triggered"));
    json_decref(reply);
    tell(r, fd,
         "{\"request\":\"set\",\"node\":\"b\",\"settings\":{\"time-triggered\":\"off\"}}");
    close(fd);
}

/* Before the first reference message no basic cycle is under way. */
TEST_WITH(status_tells_of_model_schedule_and_sleep, set_up_scheduled, tear_down)
{
    const rig *r = *state;
    char printed[TEXT_MAX] = "";
    int fd = connect_client(r);
    json_t *reply = grant(r, fd, "{\"request\":\"status\"}");
    const json_t *nodes = json_object_get(json_object_get(reply, "status"), "nodes");
    const json_t *a = json_array_get(nodes, 0), *b = json_array_get(nodes, 1);
    const json_t *schedule = json_object_get(a, "schedule");
    assert_string_equal(text(a, "controller"), "full");
    assert_string_equal(text(b, "controller"), "queue");
    assert_string_equal(text(json_object_get(b, "settings"), "wake-time"), "2ms");
    assert_true(json_is_false(json_object_get(schedule, "in_cycle")));
    assert_true(json_is_null(json_object_get(schedule, "cycle_time")));
    print_status(printed, reply);
    json_decref(reply);
    close(fd);
    assert_non_null(strstr(printed, "\n\t  controller full\n\t  local-time "));
    assert_non_null(strstr(printed, "\n\t  schedule cycle 0 of 1 references 0, waits for the next "
                                    "one\n"));
    assert_non_null(strstr(printed, "\n\t  wake-time 2ms wake-on 500:7F0\n"));
    assert_null(strstr(printed, "wake-filter"));
    assert_null(strstr(printed, "controller queue"));
}
