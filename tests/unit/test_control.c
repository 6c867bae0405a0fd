/* SPDX-License-Identifier: MIT
 *
 * test_control.c - the control socket: requests, live events, and clients that mean harm.
 *
 * Server and clients are in this process, on a real socket in a folder of its own. The engine is
 * the fake of fake_engine.h.
 */
#include "base/yamlfile.h"
#include "fake_engine.h"
#include "serve/control.h"
#include "serve/requests.h"
#include "serve/server.h"
#include "serve/status.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <jansson.h>
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>
#include <yaml.h>

#include <cmocka.h>

#define PATIENCE_TURNS 200000 /* of the loop, until something that must come counts as missing */
#define UPDATE_BITS 2000
#define TEXT_MAX (1u << 16)

/* ---- What is done between two looks at the bus ----------------------------------------------- */

/* Where it counts, the clock goes on by a step at each look at it, so that the number of looks is
 * the time: nothing here depends on the machine. */
#define STEP_S 0.001

static struct {
    bool counts;
    ev_tstamp now;
    unsigned reads;
    size_t bytes;
    unsigned lines;
    size_t yaml_characters;
    size_t yaml_events;
} work;

/* In place of that of libev, and recv() of that of the C library, for all of this program. */
ev_tstamp ev_time(void)
{
    struct timespec t;
    if (work.counts)
        return work.now += STEP_S;
    (void)clock_gettime(CLOCK_REALTIME, &t);
    return (ev_tstamp)t.tv_sec + (ev_tstamp)t.tv_nsec * 1e-9;
}

/* What libyaml reads of the texts of rules. */
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

ssize_t recv(int fd, void *out, size_t size, int flags)
{
    ssize_t count = recvfrom(fd, out, size, flags, NULL, NULL);
    if (flags & MSG_DONTWAIT) { /* the server's */
        work.reads++;
        work.bytes += count > 0 ? (size_t)count : 0;
    }
    return count;
}

/* ---- A bus with a control socket ------------------------------------------------------------- */

typedef struct rig {
    char folder[32];
    char path[64];
    struct ev_loop *loop;
    live *live;
    engine engine;
    control *control;
    bool reloads_take_long;
} rig;

static const char config_text[] =
    "bus: { name: test, bitrate: 500000 }\n"
    "nodes: [ { name: a, warning-limit: 90 }, { name: b }, { name: c, restart-ms: 100 } ]\n"
    "faults:\n"
    "  - { name: configured, when: { frame: \"7FF\" }, do: { flip: \"crc[3]\" } }\n";

static cfg *load(const rig *r)
{
    char file[96];
    snprintf(file, sizeof file, "%s/bus.yaml", r->folder);
    FILE *out = fopen(file, "we");
    assert_non_null(out);
    fprintf(out, "%scontrol: %s\n", config_text, r->path);
    fclose(out);
    cfg *config = cfg_load(file, stderr);
    assert_non_null(config);
    unlink(file);
    return config;
}

static int set_up(void **state)
{
    rig *r = calloc(1, sizeof *r);
    strcpy(r->folder, "/tmp/test_control.XXXXXX");
    assert_non_null(mkdtemp(r->folder));
    snprintf(r->path, sizeof r->path, "%s/bus.sock", r->folder);
    r->loop = ev_loop_new(0);
    r->live = live_new(load(r));
    uint16_t more = (uint16_t)(CW_RULES_MAX - live_config(r->live)->rule_count);
    assert_true(fake_engine_make(&r->engine, r->live, more, UPDATE_BITS));
    r->control = control_start(r->loop, r->live, &r->engine, -1);
    assert_non_null(r->control);
    control_on_reload(r->control, fake_engine_ask, &r->engine);
    engine_observe(&r->engine, control_event, r->control);
    *state = r;
    return 0;
}

static int tear_down(void **state)
{
    rig *r = *state;
    control_stop(r->control);
    live_free(r->live);
    free(r->engine.memory);
    ev_loop_destroy(r->loop);
    assert_int_equal(access(r->path, F_OK), -1); /* the socket went with the server */
    assert_int_equal(rmdir(r->folder), 0);
    free(r);
    return 0;
}

static void turn(const rig *r)
{
    ev_run(r->loop, EVRUN_NOWAIT);
    if (!r->reloads_take_long)
        fake_engine_answer((engine *)(uintptr_t)&r->engine, r->control);
}

static void turns(const rig *r, unsigned count)
{
    for (unsigned i = 0; i < count; i++)
        turn(r);
}

/* ---- Clients --------------------------------------------------------------------------------- */

/* -1 when the server's queue is full. */
static int try_to_connect(const rig *r)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    strcpy(address.sun_path, r->path);
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    assert_true(fd >= 0);
    if (connect(fd, (struct sockaddr *)&address, sizeof address) == 0)
        return fd;
    close(fd);
    return -1;
}

static int connect_client(const rig *r)
{
    int fd = try_to_connect(r);
    assert_true(fd >= 0);
    return fd;
}

/* Sends all of it while the server works; false when it hangs up. */
static bool send_bytes(const rig *r, int fd, const char *bytes, size_t length)
{
    size_t sent = 0;
    for (unsigned i = 0; sent < length && i < PATIENCE_TURNS; i++) {
        ssize_t count = send(fd, bytes + sent, length - sent, MSG_NOSIGNAL);
        if (count < 0 && errno != EAGAIN)
            return false;
        sent += count > 0 ? (size_t)count : 0;
        turn(r);
    }
    assert_int_equal(sent, length);
    return true;
}

static void send_text(const rig *r, int fd, const char *text)
{
    assert_true(send_bytes(r, fd, text, strlen(text)));
}

/* The next line, without its end; NULL when the server has hung up. Byte by byte: nothing that
 * comes after the line is taken. */
static const char *next_line(const rig *r, int fd)
{
    static char line[1u << 20];
    size_t length = 0;
    for (unsigned i = 0; i < PATIENCE_TURNS;) {
        ssize_t count = recv(fd, line + length, 1, 0);
        if (count == 0 || (count < 0 && errno != EAGAIN))
            return NULL;
        if (count < 0) {
            turn(r);
            i++;
        } else if (line[length++] == '\n') {
            line[length - 1] = '\0';
            return line;
        }
        assert_true(length < sizeof line);
    }
    fail_msg("no line came");
    return NULL;
}

static json_t *next_json(const rig *r, int fd)
{
    const char *line = next_line(r, fd);
    assert_non_null(line);
    json_t *value = json_loads(line, JSON_REJECT_DUPLICATES, NULL);
    if (!value)
        fail_msg("no JSON: %s", line);
    return value;
}

static json_t *ask(const rig *r, int fd, const char *request)
{
    send_text(r, fd, request);
    send_text(r, fd, "\n");
    return next_json(r, fd);
}

static const char *text(const json_t *object, const char *key)
{
    return json_string_value(json_object_get(object, key));
}

static json_int_t number(const json_t *object, const char *key)
{
    const json_t *value = json_object_get(object, key);
    if (!json_is_integer(value))
        fail_msg("no number: %s", key);
    return json_integer_value(value);
}

static bool is_on(const json_t *object, const char *key)
{
    return json_is_true(json_object_get(object, key));
}

/* Asks what must be granted. */
static json_t *grant(const rig *r, int fd, const char *request)
{
    json_t *reply = ask(r, fd, request);
    if (!is_on(reply, "ok"))
        fail_msg("%s: %s", request, text(reply, "error"));
    return reply;
}

static void tell(const rig *r, int fd, const char *request)
{
    json_decref(grant(r, fd, request));
}

/* Asks what must be refused, with these words in the error. */
static void expect_refusal(const rig *r, int fd, const char *request, const char *words)
{
    json_t *reply = ask(r, fd, request);
    const char *error = text(reply, "error");
    if (!json_is_false(json_object_get(reply, "ok")) || !error || !strstr(error, words))
        fail_msg("%.100s: expected \"%s\", got \"%s\"", request, words, error ? error : "no error");
    json_decref(reply);
}

/* The server must still serve others. */
static void expect_service(const rig *r)
{
    int fd = connect_client(r);
    tell(r, fd, "{\"request\":\"faults\"}");
    close(fd);
    turns(r, 4);
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

static void id_goes_back(void **state)
{
    const rig *r = *state;
    int fd = connect_client(r);
    json_t *reply = grant(r, fd, "{\"id\":42,\"request\":\"faults\"}");
    assert_int_equal(number(reply, "id"), 42);
    json_decref(reply);
    reply = ask(r, fd, "{\"id\":\"x\",\"request\":\"nothing\"}");
    assert_string_equal(text(reply, "id"), "x");
    assert_false(is_on(reply, "ok"));
    json_decref(reply);
    reply = grant(r, fd, "{\"request\":\"faults\"}");
    assert_null(json_object_get(reply, "id"));
    json_decref(reply);
    close(fd);
}

static void status_tells_of_bus_and_nodes(void **state)
{
    rig *r = *state;
    const cw_frame frame = {.id = 0x123, .dlc = 2};
    int fd = connect_client(r);
    cw_node_send(r->engine.bus, 0, &frame, 0);
    json_t *reply = grant(r, fd, "{\"request\":\"status\"}");
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
    json_decref(reply);
    close(fd);
}

/* What `canwire status` prints, in the layout of iproute2. */
static void status_prints_as_ip_does(void **state)
{
    rig *r = *state;
    char printed[TEXT_MAX] = "";
    int fd = connect_client(r);
    tell(r, fd,
         "{\"request\":\"set\",\"node\":\"b\","
         "\"settings\":{\"listen-only\":true,\"one-shot\":true}}");
    json_t *reply = grant(r, fd, "{\"request\":\"status\"}");
    FILE *out = fmemopen(printed, sizeof printed, "w");
    status_print(out, json_object_get(reply, "status"));
    fclose(out);
    json_decref(reply);
    close(fd);
    assert_non_null(strstr(printed, "test: bitrate 500000 up 0."));
    assert_non_null(strstr(printed, "\n3: c: qlen 16 order priority\n"
                                    "    can state ERROR-ACTIVE (berr-counter tx 0 rx 0) "
                                    "restart-ms 100\n"
                                    "\t  bitrate 500000 "));
    assert_non_null(strstr(printed, "    can <LISTEN-ONLY,ONE-SHOT> state ERROR-ACTIVE ("));
    assert_non_null(strstr(printed, "\n\t  re-started bus-errors arbit-lost error-warn error-pass "
                                    "bus-off\n"
                                    "\t  0          0          0          0          0          "
                                    "0\n"));
    assert_non_null(strstr(printed, "\n    RX:  bytes packets errors dropped  missed   mcast\n"
                                    "             0       0      0       0       0       0\n"
                                    "    TX:  bytes packets errors dropped carrier collsns\n"));
}

/* What is not there must not end the tool. */
static void status_prints_what_is_no_status(void **state)
{
    (void)state;
    char printed[TEXT_MAX] = "";
    json_t *odd = json_loads("{\"bus\":7,\"nodes\":[{},3,null]}", 0, NULL);
    FILE *out = fmemopen(printed, sizeof printed, "w");
    status_print(out, odd);
    status_print(out, NULL);
    status_print_faults(out, odd);
    fclose(out);
    json_decref(odd);
}

static const char manual_rule[] =
    "{\"request\":\"inject\",\"text\":\"- {name: by-hand, when: {manual: yes}, "
    "do: {counters: b, tec: 100}}\\n"
    "- {name: then, when: {after: {rule: by-hand, delay: 1bit}}, do: {bus-off: a}}\"}";

static void rules_are_injected_fired_and_cleared(void **state)
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

static void bad_rules_are_refused_with_their_place(void **state)
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

static void a_full_bus_takes_no_rules(void **state)
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

static void nodes_are_restarted(void **state)
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

static void settings_are_changed(void **state)
{
    rig *r = *state;
    int fd = connect_client(r);
    json_t *reply = grant(r, fd,
                          "{\"request\":\"set\",\"node\":\"a\",\"settings\":{\"one-shot\":true,"
                          "\"berr-reporting\":\"on\","
                          "\"lost-arbitration-reporting\":true,\"restart-ms\":\"250\",\"queue\":3,"
                          "\"order\":\"fifo\",\"warning-limit\":255}}");
    const json_t *now = json_object_get(reply, "settings");
    assert_true(is_on(now, "one-shot") && is_on(now, "berr-reporting"));
    assert_true(is_on(now, "lost-arbitration-reporting"));
    assert_false(is_on(now, "loopback"));
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
    json_decref(reply);
    close(fd);
}

static void reload_tells_errors(void **state)
{
    rig *r = *state;
    int fd = connect_client(r);
    tell(r, fd, "{\"request\":\"reload\"}");
    r->engine.reload_errors = "bus.yaml:7:3: first\nbus.yaml:9:1: second\n";
    json_t *reply = ask(r, fd, "{\"request\":\"reload\"}");
    assert_int_equal(number(reply, "line"), 7);
    assert_int_equal(number(reply, "column"), 3);
    assert_int_equal(json_array_size(json_object_get(reply, "errors")), 2);
    json_decref(reply);
    close(fd);
}

/* Each gets the outcome of the round in which its reload was, and all others go on meanwhile. */
static void a_reload_that_takes_long_holds_up_nobody_else(void **state)
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
    control_reloaded(r->control, 3, NULL); /* nobody waits for it any more */
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
    {"{\"request\":\"set\",\"node\":\"a\",\"settings\":{\"order\":\"lifo\"}}", "priority or fifo",
     false},
    {"{\"request\":\"set\",\"node\":\"a\",\"settings\":{\"loopback\":1}}", "on or off", false},
    {"{\"request\":\"set\",\"node\":\"a\",\"settings\":{\"restart\":1}}", "restart-ms", false},
    {"{\"request\":\"set\",\"node\":\"a\",\"settings\":{\"q\":1}}", "there are loopback", false},
    {"{\"request\":\"watch\",\"events\":[\"txx\"]}", "kind of event 'txx'", false},
    {"{\"request\":\"watch\",\"events\":[\"tolerated\"]}", "kind of event", false},
    {"{\"request\":\"watch\",\"events\":[7]}", "kind of event", false},
    {"{\"request\":\"inject\",\"text\":\"\"}", "", false},
    {"[[[[[[[[[[]]]]]]]]]]", "nested too deep", true},
    {"{\"a\":99999999999999999999}", "too big integer", true},
};

static void what_is_not_understood_is_refused(void **state)
{
    const rig *r = *state;
    int fd = connect_client(r);
    for (size_t i = 0; i < sizeof refusals / sizeof refusals[0]; i++) {
        const refusal *row = &refusals[i];
        expect_refusal(r, fd, row->request, row->words);
        json_t *reply = ask(r, fd, row->request);
        if (row->placed && (number(reply, "line") != 1 || number(reply, "column") < 1))
            fail_msg("%s: no place", row->request);
        json_decref(reply);
    }
    tell(r, fd, "{\"request\":\"status\"}"); /* the connection is good for more */
    close(fd);
}

/* ---- Events ---------------------------------------------------------------------------------- */

static void send_frame(rig *r)
{
    const cw_frame frame = {.id = 0x123, .dlc = 1, .data = {0xAB}};
    assert_int_equal(cw_node_send(r->engine.bus, 0, &frame, 0), CW_OK);
    engine_update(&r->engine);
}

static void watchers_see_what_they_asked_for(void **state)
{
    rig *r = *state;
    int all = connect_client(r), some = connect_client(r), none = connect_client(r);
    tell(r, all, "{\"request\":\"watch\"}");
    json_t *reply = grant(r, some, "{\"request\":\"watch\",\"events\":[\"tx\"]}");
    assert_int_equal(json_array_size(json_object_get(reply, "events")), 1);
    json_decref(reply);
    tell(r, none, "{\"request\":\"watch\"}");
    tell(r, none, "{\"request\":\"watch\",\"events\":[]}"); /* the last one counts */
    send_frame(r);
    assert_non_null(
        strstr(next_line(r, some), "\"node\":\"a\",\"event\":\"tx\",\"frame\":\"123#AB\""));
    assert_non_null(
        strstr(next_line(r, all), "\"node\":\"b\",\"event\":\"rx\",\"frame\":\"123#AB\""));
    assert_non_null(strstr(next_line(r, all), "\"node\":\"c\",\"event\":\"rx\""));
    assert_non_null(strstr(next_line(r, all), "\"event\":\"tx\""));
    tell(r, none, "{\"request\":\"faults\"}"); /* no event came before */
    tell(r, some, "{\"request\":\"faults\"}"); /* replies come in between */
    close(all);
    close(some);
    close(none);
}

static void injected_rules_have_their_names_in_events(void **state)
{
    rig *r = *state;
    int fd = connect_client(r);
    tell(r, fd, "{\"request\":\"watch\",\"events\":[\"fault\"]}");
    tell(r, fd,
         "{\"request\":\"inject\",\"text\":\"- {name: mine, when: {frame: \\\"123\\\", "
         "count: 1}, do: {flip: \\\"crc[3]\\\"}}\"}");
    send_frame(r);
    assert_non_null(strstr(next_line(r, fd), "\"event\":\"fault\",\"rule\":\"mine\",\"hit\":1}"));
    close(fd);
}

/* Events come all or are counted, and in the end their sum is right. */
static void slow_watchers_lose_events_and_are_told(void **state)
{
    rig *r = *state;
    int fd = connect_client(r);
    uint64_t sent = 0, got = 0, lost = 0;
    tell(r, fd, "{\"request\":\"watch\",\"events\":[\"tx\"]}");
    for (; sent < 20000; sent++) {
        send_frame(r);
        if (sent % 64 == 0)
            turn(r);
    }
    while (got + lost < sent) {
        json_t *line = next_json(r, fd);
        if (json_object_get(line, "lost"))
            lost += (uint64_t)number(line, "lost");
        else
            got++;
        json_decref(line);
    }
    assert_int_equal(got + lost, sent);
    assert_true(lost > 0 && got > 1000);
    send_frame(r);
    assert_non_null(strstr(next_line(r, fd), "\"tx\""));
    close(fd);
}

/* Counts lines until the server hangs up. */
static void *read_to_the_end(void *user)
{
    int *fd = user;
    char bytes[4096];
    uintptr_t lines = 0;
    for (ssize_t count; (count = recv(*fd, bytes, sizeof bytes, 0)) > 0;)
        for (ssize_t i = 0; i < count; i++)
            lines += bytes[i] == '\n';
    return (void *)lines;
}

/* The server stops while lines wait for a client that reads and for one that does not. */
static void what_waits_at_the_end_is_still_written(void **state)
{
    rig *r = *state;
    int reader = connect_client(r), sleeper = connect_client(r);
    tell(r, reader, "{\"request\":\"watch\",\"events\":[\"tx\"]}");
    tell(r, sleeper, "{\"request\":\"watch\",\"events\":[\"tx\"]}");
    for (unsigned i = 0; i < 3000; i++)
        send_frame(r);
    assert_int_equal(fcntl(reader, F_SETFL, 0), 0);
    pthread_t thread;
    void *lines;
    assert_int_equal(pthread_create(&thread, NULL, read_to_the_end, &reader), 0);
    control_stop(r->control);
    r->control = NULL;
    assert_int_equal(pthread_join(thread, &lines), 0);
    assert_int_equal((uintptr_t)lines, 3000);
    close(reader);
    close(sleeper);
}

/* ---- Clients that mean harm ------------------------------------------------------------------ */

static void requests_may_come_in_pieces_and_in_heaps(void **state)
{
    const rig *r = *state;
    int fd = connect_client(r);
    const char *request = "{\"request\":\"faults\"}\r\n";
    for (const char *c = request; *c; c++)
        assert_true(send_bytes(r, fd, c, 1));
    json_decref(next_json(r, fd));
    send_text(r, fd,
              "\n\n  \n{\"id\":1,\"request\":\"faults\"}\n{\"id\":2,\"request\":\"faults\"}\n\n");
    for (int id = 1; id <= 2; id++) {
        json_t *reply = next_json(r, fd);
        assert_int_equal(number(reply, "id"), id);
        json_decref(reply);
    }
    close(fd);
}

static void replies_come_before_the_end(void **state)
{
    const rig *r = *state;
    int fd = connect_client(r);
    for (int i = 0; i < 100; i++)
        send_text(r, fd, "{\"request\":\"status\"}\n");
    send_text(r, fd, "{\"request\":\"cle"); /* half a request is none */
    shutdown(fd, SHUT_WR);
    for (int i = 0; i < 100; i++)
        json_decref(next_json(r, fd));
    assert_null(next_line(r, fd));
    close(fd);
}

static void half_lines_hold_up_nobody(void **state)
{
    const rig *r = *state;
    int fds[SERVER_USER_MAX - 1];
    for (unsigned i = 0; i < SERVER_USER_MAX - 1; i++) {
        fds[i] = connect_client(r);
        send_text(r, fds[i], "{\"request\":");
    }
    expect_service(r);
    for (unsigned i = 0; i < SERVER_USER_MAX - 1; i++) {
        send_text(r, fds[i], "\"faults\"}\n");
        json_decref(next_json(r, fds[i]));
        close(fds[i]);
    }
}

static void long_lines_end_the_connection(void **state)
{
    const rig *r = *state;
    int fd = connect_client(r);
    size_t length = SERVER_LINE_MAX + SERVER_LINE_MAX / 2;
    char *line = malloc(length);
    memset(line, 'x', length);
    (void)send_bytes(r, fd, line, length); /* it may hang up on the way */
    assert_non_null(strstr(next_line(r, fd), "too long"));
    assert_null(next_line(r, fd));
    close(fd);
    expect_service(r);
    free(line);
}

/* Returns a request of this length; `filler` stands between head and tail. */
static char *make_request(const char *head, char filler, const char *tail, size_t length)
{
    char *line = malloc(length + 1);
    memset(line, filler, length);
    memcpy(line, head, strlen(head));
    strcpy(line + length - strlen(tail), tail);
    return line;
}

static void only_inject_may_be_long(void **state)
{
    const rig *r = *state;
    int fd = connect_client(r);
    char *line = make_request("{\"request\":\"status\"", ' ', "}", REQUEST_BYTES_MAX + 1);
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
    free(line);
    close(fd);
}

static void deep_and_wide_requests_are_refused(void **state)
{
    const rig *r = *state;
    int fd = connect_client(r);
    static const char fillers[] = "[{\",:";
    for (const char *filler = fillers; *filler; filler++) {
        char *line = make_request("{\"a\":", *filler, "}", SERVER_LINE_MAX);
        expect_refusal(r, fd, line, "");
        free(line);
    }
    char *line = make_request("{\"request\":\"status\",\"a\":[0", ',', "]}", REQUEST_BYTES_MAX);
    expect_refusal(r, fd, line, "too many values");
    free(line);
    close(fd);
}

/* A text of rules is read while the bus waits: not again and again, and not more than rules need.
 */
static void a_text_of_rules_makes_little_work(void **state)
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
        char *line = make_request(head, ',', tail, SERVER_LINE_MAX);
        for (size_t k = strlen(head); i == 0 && k < 2 * (YAML_TEXT_NODES_MAX - 100); k += 2)
            line[k] = '1';
        work.yaml_characters = work.yaml_events = 0;
        expect_refusal(r, fd, line, "inject:");
        assert_in_range(work.yaml_characters, SERVER_LINE_MAX / 8, 3 * SERVER_LINE_MAX);
        assert_in_range(work.yaml_events, 1, 3 * YAML_TEXT_NODES_MAX);
        free(line);
    }
    close(fd);
}

static void noise_is_refused(void **state)
{
    const rig *r = *state;
    static char noise[REQUEST_BYTES_MAX];
    uint32_t random = 1;
    int fd = connect_client(r);
    for (size_t i = 0; i < sizeof noise; i++) {
        random = random * 1664525u + 1013904223u;
        noise[i] = (char)(random >> 24);
    }
    noise[sizeof noise - 1] = '\n';
    unsigned lines = 0;
    for (size_t begin = 0, i = 0; i < sizeof noise; i++) {
        if (noise[i] != '\n')
            continue;
        lines += strspn(noise + begin, " \t\r") < i - begin;
        begin = i + 1;
    }
    assert_true(send_bytes(r, fd, noise, sizeof noise));
    for (; lines > 0; lines--) {
        json_t *reply = next_json(r, fd);
        assert_false(is_on(reply, "ok"));
        json_decref(reply);
    }
    tell(r, fd, "{\"request\":\"status\"}");
    close(fd);
}

static void readers_who_do_not_read_are_disconnected(void **state)
{
    const rig *r = *state;
    int fd = connect_client(r);
    bool alive = true;
    for (unsigned i = 0; alive && i < 20000; i++)
        alive = send_bytes(r, fd, "{\"request\":\"status\"}\n", 21);
    assert_false(alive);
    close(fd);
    expect_service(r);
}

static void one_too_many_is_told(void **state)
{
    const rig *r = *state;
    int fds[SERVER_USER_MAX];
    for (unsigned i = 0; i < SERVER_USER_MAX; i++) {
        fds[i] = connect_client(r);
        turn(r);
    }
    int fd = connect_client(r);
    assert_non_null(strstr(next_line(r, fd), "too many connections"));
    assert_null(next_line(r, fd));
    close(fd);
    close(fds[17]);
    turns(r, 4);
    expect_service(r); /* a place is free again */
    for (unsigned i = 0; i < SERVER_USER_MAX; i++)
        if (i != 17)
            close(fds[i]);
}

static void thousand_connections_do_no_harm(void **state)
{
    const rig *r = *state;
    static int fds[1000];
    struct rlimit limit = {.rlim_cur = 2048, .rlim_max = 4096};
    getrlimit(RLIMIT_NOFILE, &limit);
    limit.rlim_cur = limit.rlim_max < 4096 ? limit.rlim_max : 4096;
    setrlimit(RLIMIT_NOFILE, &limit);
    for (unsigned i = 0; i < 1000; i++) {
        fds[i] = try_to_connect(r);
        if (fds[i] >= 0)
            (void)send(fds[i], "{\"request\":\"status\"}\n{", 22, MSG_NOSIGNAL);
        if (i % 8 == 0)
            turn(r);
    }
    turns(r, 100);
    for (unsigned i = 0; i < 1000; i++)
        if (fds[i] >= 0)
            close(fds[i]);
    turns(r, 100);
    expect_service(r);
}

static int64_t now_us(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * INT64_C(1000000) + t.tv_nsec / 1000;
}

/* The bus must have its turn between any two requests of a client. */
static void a_heap_of_requests_leaves_time_for_the_bus(void **state)
{
    const rig *r = *state;
    int fds[16];
    unsigned served = 0, wakeups = 0;
    static char heap[2000 * 4 + 1];
    for (unsigned i = 0; i < 2000; i++)
        memcpy(heap + (size_t)4 * i, "[3]\n", 4);
    for (unsigned i = 0; i < 16; i++) {
        fds[i] = connect_client(r);
        assert_int_equal(send(fds[i], heap, sizeof heap - 1, MSG_NOSIGNAL), sizeof heap - 1);
    }
    int64_t longest_us = 0;
    while (served < 16 * 2000 && wakeups < PATIENCE_TURNS) {
        char replies[65536];
        int64_t start = now_us();
        turn(r);
        int64_t took = now_us() - start;
        longest_us = took > longest_us ? took : longest_us;
        wakeups++;
        for (unsigned i = 0; i < 16; i++) {
            ssize_t count = recv(fds[i], replies, sizeof replies, 0);
            for (ssize_t k = 0; k < count; k++)
                served += replies[k] == '\n';
        }
    }
    assert_int_equal(served, 16 * 2000);
    assert_true(wakeups >= 2000); /* one request of a client each */
    print_message("longest turn %lld us\n", (long long)longest_us);
    for (unsigned i = 0; i < 16; i++)
        close(fds[i]);
}

/* ---- The socket itself ----------------------------------------------------------------------- */

static void nobody_called(void *user, server_client *client, char *line, size_t length)
{
    (void)user;
    (void)client;
    (void)line;
    (void)length;
}

static void nothing_drained(void *user, server_client *client)
{
    (void)user;
    (void)client;
}

static void nothing_closed(void *user, unsigned client)
{
    (void)user;
    (void)client;
}

static const server_calls no_calls = {nobody_called, nothing_drained, nothing_closed, "", "", ""};

/* ---- Places ---------------------------------------------------------------------------------- */

/* A server of its own, whose clock stands still, and which answers each line with itself. */
typedef struct hall {
    const rig *rig;
    rig place; /* its path, for connect_client() */
    server *server;
} hall;

static ev_tstamp hall_time_s;

static ev_tstamp read_hall_clock(struct ev_loop *loop)
{
    (void)loop;
    return hall_time_s;
}

static void keep_or_echo(void *user, server_client *client, char *line, size_t length)
{
    (void)user;
    work.lines++;
    if (strcmp(line, "keep") == 0)
        server_keep(client, true);
    line[length] = '\n';
    server_write(client, line, length + 1);
}

static const server_calls hall_calls = {keep_or_echo, nothing_drained, nothing_closed,
                                        "too many\n", "too quiet\n",   "too long\n"};

static void open_hall(hall *h, const rig *r)
{
    *h = (hall){.rig = r, .place = *r};
    snprintf(h->place.path, sizeof h->place.path, "%s/hall", r->folder);
    h->server = server_start(r->loop, h->place.path, -1, &hall_calls, NULL);
    assert_non_null(h->server);
    hall_time_s = 1000.0;
    server_set_clock(h->server, read_hall_clock);
    assert_int_equal(chmod(r->folder, 0755), 0); /* other users come */
    assert_int_equal(chmod(h->place.path, 0666), 0);
}

static void close_hall(hall *h)
{
    server_stop(h->server);
}

/* A client of this user, who is let in or refused before this returns. */
static int come(const hall *h, uid_t user)
{
    assert_int_equal(seteuid(user), 0);
    int fd = connect_client(&h->place);
    assert_int_equal(seteuid(0), 0);
    turns(h->rig, 4);
    return fd;
}

static void expect_line(const hall *h, int fd, const char *expected)
{
    const char *line = next_line(h->rig, fd);
    assert_non_null(line);
    assert_string_equal(line, expected);
}

/* Whether the client is served. */
static void expect_echo(const hall *h, int fd)
{
    send_text(h->rig, fd, "hello\n");
    expect_line(h, fd, "hello");
}

static void expect_refused(const hall *h, uid_t user)
{
    int fd = come(h, user);
    expect_line(h, fd, "too many");
    assert_null(next_line(h->rig, fd));
    close(fd);
}

/* Fills places of this user; the clients are left open. */
static void fill(const hall *h, int *fds, unsigned count, uid_t user)
{
    for (unsigned i = 0; i < count; i++)
        fds[i] = come(h, user);
    expect_echo(h, fds[count - 1]);
}

static void close_all(const hall *h, const int *fds, unsigned count)
{
    for (unsigned i = 0; i < count; i++)
        close(fds[i]);
    turns(h->rig, 4);
}

#define STRANGER 1234u
#define FRIEND 1235u
#define DAEMON_USER 1236u /* who is not root, for once */

static bool needs_root(void)
{
    if (geteuid() != 0)
        skip();
    return geteuid() == 0;
}

#define CROWD 32u
#define HEAP_BYTES (1u << 17) /* more than is read at once, and than a socket takes at once */
#define READ_BYTES 65536u     /* at one wake-up, of one client: as in control_server.c */

/* As much as its socket takes. */
static void send_what_fits(int fd, const char *text, size_t *at)
{
    for (ssize_t count; (count = send(fd, text + *at, HEAP_BYTES - *at, MSG_NOSIGNAL)) > 0;)
        *at += (size_t)count;
}

/* A crowd that sends this, again and again; returns when so many lines were handled, or bytes
 * read. No turn of the loop may do much. */
static void hold_up(hall *h, const char *text, unsigned lines, size_t bytes)
{
    int fds[CROWD];
    size_t at[CROWD] = {0};
    unsigned all_lines = 0, turns_left = PATIENCE_TURNS;
    size_t all_bytes = 0;
    for (unsigned i = 0; i < CROWD; i++) {
        fds[i] = connect_client(&h->place);
        turn(h->rig);
    }
    while ((all_lines < lines || all_bytes < bytes) && turns_left-- > 0) {
        char echo[READ_BYTES];
        for (unsigned i = 0; i < CROWD; i++) {
            send_what_fits(fds[i], text, &at[i]);
            while (recvfrom(fds[i], echo, sizeof echo, 0, NULL, NULL) > 0)
                continue;
        }
        work.counts = true;
        work.reads = work.lines = 0;
        work.bytes = 0;
        turn(h->rig);
        work.counts = false;
        all_lines += work.lines;
        all_bytes += work.bytes;
        assert_in_range(work.lines, 0, 3); /* the time of a turn, here two looks at the clock */
        assert_in_range(work.reads, 0, CROWD);
        assert_in_range(work.bytes, 0, CROWD * READ_BYTES);
    }
    assert_true(all_lines >= lines && all_bytes >= bytes);
    for (unsigned i = 0; i < CROWD; i++)
        close(fds[i]);
    turns(h->rig, 100);
}

/* Neither many clients nor much that one of them sends. */
static void a_crowd_makes_little_work_at_a_time(void **state)
{
    hall h;
    static char heap[HEAP_BYTES];
    open_hall(&h, *state);
    memset(heap, 'x', sizeof heap); /* a line without end */
    hold_up(&h, heap, 0, CROWD * sizeof heap);
    for (size_t i = 3; i < sizeof heap; i += 4)
        heap[i] = '\n';
    hold_up(&h, heap, 5000, 0);
    close_hall(&h);
}

static void one_user_has_a_part_of_the_places(void **state)
{
    hall h;
    int fds[SERVER_USER_MAX];
    int others[SERVER_CLIENTS_MAX - SERVER_USER_MAX - 1];
    if (!needs_root())
        return;
    open_hall(&h, *state);
    fill(&h, fds, SERVER_USER_MAX, STRANGER);
    expect_refused(&h, STRANGER);
    fill(&h, others, sizeof others / sizeof others[0], FRIEND);
    expect_refused(&h, FRIEND); /* the last place is root's */
    int root = come(&h, 0);
    expect_echo(&h, root);
    expect_refused(&h, 0); /* it has had its place */
    close(root);
    turns(h.rig, 4);
    expect_refused(&h, FRIEND); /* and has it again */
    close_all(&h, fds, 1);
    int friend = come(&h, FRIEND);
    expect_echo(&h, friend);
    close(friend);
    close_all(&h, fds + 1, SERVER_USER_MAX - 1);
    close_all(&h, others, sizeof others / sizeof others[0]);
    close_hall(&h);
}

/* Which user the daemon is it sees when a client comes. */
static int come_to(const hall *h, uid_t user, uid_t daemon_user)
{
    assert_int_equal(seteuid(user), 0);
    int fd = connect_client(&h->place);
    assert_int_equal(seteuid(0), 0);
    assert_int_equal(seteuid(daemon_user), 0);
    turns(h->rig, 4);
    assert_int_equal(seteuid(0), 0);
    return fd;
}

static void one_place_is_for_root_and_one_for_its_own_user(void **state)
{
    hall h;
    int fds[SERVER_CLIENTS_MAX];
    unsigned count = 0;
    if (!needs_root())
        return;
    open_hall(&h, *state);
    for (; count < SERVER_CLIENTS_MAX - 2; count++)
        fds[count] = come_to(&h, STRANGER + 10 * (count % 2), DAEMON_USER);
    expect_echo(&h, fds[count - 1]);
    int refused = come_to(&h, FRIEND, DAEMON_USER);
    expect_line(&h, refused, "too many");
    close(refused);
    fds[count++] = come_to(&h, DAEMON_USER, DAEMON_USER);
    expect_echo(&h, fds[count - 1]);
    refused = come_to(&h, DAEMON_USER, DAEMON_USER); /* the other one is root's */
    expect_line(&h, refused, "too many");
    close(refused);
    fds[count++] = come_to(&h, 0, DAEMON_USER);
    expect_echo(&h, fds[count - 1]);
    close_all(&h, fds, count);
    close_hall(&h);
}

static void who_says_nothing_makes_room(void **state)
{
    hall h;
    int fds[SERVER_USER_MAX];
    if (!needs_root())
        return;
    open_hall(&h, *state);
    fill(&h, fds, SERVER_USER_MAX, STRANGER);
    hall_time_s += SERVER_IDLE_S - 1;
    send_text(h.rig, fds[1], "keep\n");
    expect_line(&h, fds[1], "keep");
    expect_refused(&h, STRANGER); /* none is quiet for long enough */
    hall_time_s += 0.5;
    expect_echo(&h, fds[0]); /* that one has spoken */
    hall_time_s += 0.5;
    int friend = come(&h, FRIEND); /* there is room: nobody has to go */
    expect_echo(&h, friend);
    expect_echo(&h, fds[2]);
    int late = come(&h, STRANGER);
    expect_echo(&h, late);
    expect_line(&h, fds[3], "too quiet"); /* the first of those that were quiet for longest */
    assert_null(next_line(h.rig, fds[3]));
    hall_time_s += 10 * SERVER_IDLE_S;
    close(come(&h, STRANGER));
    expect_echo(&h, fds[1]); /* who watches keeps its place */
    expect_echo(&h, friend); /* of others nobody goes for it */
    close(late);
    close(friend);
    close_all(&h, fds, SERVER_USER_MAX);
    close_hall(&h);
}

#define STUFFING_MAX 400 /* lines that fill any socket, and are fewer than disconnect the client */

/* Lines that the client does not read come back, until its socket takes no more of them. */
static void stuff(const hall *h, int fd)
{
    static char line[2001];
    memset(line, 'x', sizeof line - 1);
    line[sizeof line - 1] = '\n';
    for (unsigned i = 0; i < STUFFING_MAX; i++) {
        assert_true(send_bytes(h->rig, fd, line, sizeof line));
        turns(h->rig, 2);
    }
}

/* Reads a part of what waits for it. */
static void read_some(const hall *h, int fd)
{
    static char bytes[65536];
    for (unsigned i = 0; i < 4; i++) {
        assert_true(recv(fd, bytes, sizeof bytes, MSG_DONTWAIT) > 0);
        turns(h->rig, 2);
    }
}

/* Reads on to the end of the connection, or until nothing more comes. Whether it has ended. */
static bool read_to_end(const hall *h, int fd)
{
    static char bytes[65536];
    for (unsigned idle = 0; idle < 10; idle++) {
        ssize_t count = recv(fd, bytes, sizeof bytes, MSG_DONTWAIT);
        if (count == 0 || (count < 0 && errno == ECONNRESET))
            return true;
        idle = count > 0 ? 0 : idle;
        turns(h->rig, 2);
    }
    return false;
}

static void who_does_not_read_makes_room(void **state)
{
    hall h;
    int fds[SERVER_USER_MAX];
    if (!needs_root())
        return;
    open_hall(&h, *state);
    fill(&h, fds, SERVER_USER_MAX, STRANGER);
    send_text(h.rig, fds[1], "keep\n");
    expect_line(&h, fds[1], "keep");
    stuff(&h, fds[0]);
    stuff(&h, fds[1]); /* one that watches */
    stuff(&h, fds[2]);
    hall_time_s += SERVER_IDLE_S - 1;
    for (unsigned i = 3; i < SERVER_USER_MAX; i++)
        expect_echo(&h, fds[i]);
    expect_refused(&h, STRANGER); /* none has been like that for long enough */
    read_some(&h, fds[2]);        /* slowly, but it does */
    hall_time_s += 1;
    int first = come(&h, STRANGER);
    int second = come(&h, STRANGER);
    expect_echo(&h, first);
    expect_echo(&h, second);
    expect_refused(&h, STRANGER);
    assert_true(read_to_end(&h, fds[0]));
    assert_true(read_to_end(&h, fds[1]));
    assert_false(read_to_end(&h, fds[2]));
    close(first);
    close(second);
    close_all(&h, fds, SERVER_USER_MAX);
    close_hall(&h);
}

static void the_socket_is_for_the_group(void **state)
{
    const rig *r = *state;
    struct stat found;
    assert_int_equal(stat(r->path, &found), 0);
    assert_true(S_ISSOCK(found.st_mode));
    assert_int_equal(found.st_mode & 07777, 0660);
}

static void a_live_socket_is_not_taken(void **state)
{
    const rig *r = *state;
    assert_null(server_start(r->loop, r->path, -1, &no_calls, NULL));
    expect_service(r);
}

static void a_stale_socket_is_replaced(void **state)
{
    const rig *r = *state;
    char path[96];
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    snprintf(path, sizeof path, "%s/stale", r->folder);
    strcpy(address.sun_path, path);
    int fd = socket(AF_UNIX, SOCK_STREAM, 0);
    assert_int_equal(bind(fd, (struct sockaddr *)&address, sizeof address), 0);
    close(fd); /* as when a daemon was killed */
    server *s = server_start(r->loop, path, -1, &no_calls, NULL);
    assert_non_null(s);
    server_stop(s);
    assert_int_equal(access(path, F_OK), -1);
}

static void other_files_are_left_alone(void **state)
{
    const rig *r = *state;
    char path[96];
    snprintf(path, sizeof path, "%s/file", r->folder);
    close(open(path, O_CREAT | O_WRONLY, 0600));
    assert_null(server_start(r->loop, path, -1, &no_calls, NULL));
    assert_int_equal(unlink(path), 0);
    snprintf(path, sizeof path, "%s/no/folder", r->folder);
    assert_null(server_start(r->loop, path, -1, &no_calls, NULL));
    memset(path, 'x', sizeof path - 1);
    assert_null(server_start(r->loop,
                             "/tmp/a-path-that-is-longer-than-the-hundred-and-seven-bytes-"
                             "that-the-kernel-takes-for-the-path-of-a-socket-of-a-bus",
                             -1, &no_calls, NULL));
}

/* A socket that somebody else made at the same path stays. */
static void only_the_own_socket_is_removed(void **state)
{
    const rig *r = *state;
    char path[96];
    snprintf(path, sizeof path, "%s/mine", r->folder);
    server *first = server_start(r->loop, path, -1, &no_calls, NULL);
    assert_non_null(first);
    assert_int_equal(unlink(path), 0);
    assert_null(server_start(r->loop, path, -1, &no_calls, NULL)); /* the path is the first one's */
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    strcpy(address.sun_path, path);
    int other = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_int_equal(bind(other, (struct sockaddr *)&address, sizeof address), 0);
    server_stop(first);
    assert_int_equal(access(path, F_OK), 0);
    server *second = server_start(r->loop, path, -1, &no_calls, NULL); /* nobody listens there */
    assert_non_null(second);
    server_stop(second);
    assert_int_equal(access(path, F_OK), -1);
    close(other);
}

#define CASE(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        CASE(id_goes_back),
        CASE(status_tells_of_bus_and_nodes),
        CASE(status_prints_as_ip_does),
        CASE(status_prints_what_is_no_status),
        CASE(rules_are_injected_fired_and_cleared),
        CASE(bad_rules_are_refused_with_their_place),
        CASE(a_full_bus_takes_no_rules),
        CASE(nodes_are_restarted),
        CASE(settings_are_changed),
        CASE(reload_tells_errors),
        CASE(a_reload_that_takes_long_holds_up_nobody_else),
        CASE(what_is_not_understood_is_refused),
        CASE(watchers_see_what_they_asked_for),
        CASE(injected_rules_have_their_names_in_events),
        CASE(slow_watchers_lose_events_and_are_told),
        CASE(what_waits_at_the_end_is_still_written),
        CASE(requests_may_come_in_pieces_and_in_heaps),
        CASE(replies_come_before_the_end),
        CASE(half_lines_hold_up_nobody),
        CASE(long_lines_end_the_connection),
        CASE(only_inject_may_be_long),
        CASE(deep_and_wide_requests_are_refused),
        CASE(a_text_of_rules_makes_little_work),
        CASE(noise_is_refused),
        CASE(readers_who_do_not_read_are_disconnected),
        CASE(one_too_many_is_told),
        CASE(a_crowd_makes_little_work_at_a_time),
        CASE(one_user_has_a_part_of_the_places),
        CASE(one_place_is_for_root_and_one_for_its_own_user),
        CASE(who_says_nothing_makes_room),
        CASE(who_does_not_read_makes_room),
        CASE(thousand_connections_do_no_harm),
        CASE(a_heap_of_requests_leaves_time_for_the_bus),
        CASE(the_socket_is_for_the_group),
        CASE(a_live_socket_is_not_taken),
        CASE(a_stale_socket_is_replaced),
        CASE(other_files_are_left_alone),
        CASE(only_the_own_socket_is_removed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
