/* SPDX-License-Identifier: MIT
 *
 * test_config.c - configuration files: what is read from good ones, what is said about bad ones.
 *
 * Runs at the top of the source tree. Each file in tests/config/bad begins with its errors, one a
 * line: "# expect: LINE:COLUMN: a part of the message".
 */
#include "base/yamlfile.h"
#include "config/config.h"

#include <dirent.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))
#define GOOD "tests/config/good/"
#define BAD "tests/config/bad/"
#define BYTES(text) text, sizeof(text) - 1
#define EXPECT "# expect: "
#define PATH_SIZE 300
#define LINE_SIZE 2000
#define TICKS_PER_S UINT64_C(80000000)

/* What a load said, to be freed; NULL when it was good. */
static char *errors_of(const char *file)
{
    char *text = NULL;
    size_t length = 0;
    FILE *out = open_memstream(&text, &length);
    cfg *config;
    size_t rule_count;

    assert_non_null(out);
    bool good = cfg_check(&config, &rule_count, file, out);
    fclose(out);
    assert_true(good == (length == 0));
    cfg_free(config);
    if (length == 0) {
        free(text);
        return NULL;
    }
    return text;
}

static cfg *load_good(const char *file)
{
    cfg *config = cfg_load(file, stderr);

    assert_non_null(config);
    return config;
}

/* Calls back for each *.yaml in a directory, and counts them. */
static unsigned each_file(const char *directory, void (*check)(const char *path))
{
    DIR *entries = opendir(directory);
    struct dirent *entry;
    unsigned count = 0;

    assert_non_null(entries);
    while ((entry = readdir(entries)) != NULL) {
        char path[PATH_SIZE];

        if (!strstr(entry->d_name, ".yaml"))
            continue;
        snprintf(path, sizeof path, "%s%s", directory, entry->d_name);
        check(path);
        count++;
    }
    closedir(entries);
    return count;
}

static void check_good(const char *path)
{
    char *errors = errors_of(path);

    if (errors)
        fail_msg("%s", errors);
}

static void good_files_are_accepted(void **state)
{
    (void)state;
    assert_in_range(each_file(GOOD, check_good), 5, 1000);
    assert_in_range(each_file("config/profiles/", check_good), 12, 1000);
    check_good("config/example.yaml");
}

/* Whether a line is PATH:EXPECTED, where EXPECTED may stop in the middle of the message. It may
 * also name a file of its own. */
static bool fits(const char *line, const char *path, const char *expected)
{
    size_t length = strlen(path);
    size_t place = strcspn(expected, " ");

    if (strncmp(line, path, length) == 0 && line[length] == ':')
        line += length + 1;
    return strncmp(line, expected, place) == 0 &&
           strstr(line + place, expected + place + 1) != NULL;
}

/* Compares the errors, line by line, with the head of the file. */
static void check_bad(const char *path)
{
    char *errors = errors_of(path);
    char *rest = errors;
    FILE *file = fopen(path, "r");
    char expected[LINE_SIZE];

    assert_non_null(file);
    if (!errors)
        fail_msg("%s was accepted", path);
    while (fgets(expected, sizeof expected, file) && strncmp(expected, EXPECT, 10) == 0) {
        char *line = strsep(&rest, "\n");

        expected[strcspn(expected, "\n")] = '\0';
        if (!line || !fits(line, path, expected + strlen(EXPECT)))
            fail_msg("%s: expected %s\ngot %s", path, expected + strlen(EXPECT),
                     line ? line : "nothing");
    }
    if (rest && *rest)
        fail_msg("%s: not expected: %s", path, rest);
    fclose(file);
    free(errors);
}

static void bad_files_are_refused_with_all_errors(void **state)
{
    (void)state;
    assert_in_range(each_file(BAD, check_bad), 30, 1000);
}

static void defaults_are_set(void **state)
{
    cfg *config = load_good(GOOD "minimal.yaml");
    const cfg_node *node = &config->nodes[0];

    (void)state;
    assert_string_equal(config->file, GOOD "minimal.yaml");
    assert_string_equal(config->bus_name, "can");
    assert_int_equal(config->bit_ticks, 160);
    assert_int_equal(config->seed, 0);
    assert_int_equal(config->node_count, 1);
    assert_string_equal(node->name, "a");
    assert_null(node->port);
    assert_int_equal(node->modes, 0);
    assert_false(node->berr_reporting);
    assert_int_equal(node->order, CW_ORDER_PRIORITY);
    assert_int_equal(node->queue, 16);
    assert_int_equal(node->warning_limit, 96);
    assert_int_equal(node->restart_ms, 0);
    assert_int_equal(node->traffic_count, 0);
    assert_int_equal(node->line, 3);
    assert_int_equal(config->rule_count, 0);
    assert_false(config->lcm.enabled);
    assert_null(config->control);
    assert_int_equal(config->pacing, CFG_PACING_PRECISE);
    assert_int_equal(config->missing_port, CFG_MISSING_PORT_FAIL);
    assert_int_equal(config->catch_up.ns, 1000000000);
    cfg_free(config);
}

static void lcm_defaults_are_set(void **state)
{
    cfg *config = load_good(GOOD "quoted.yaml");

    (void)state;
    assert_true(config->lcm.enabled);
    assert_string_equal(config->lcm.url, "udpm://239.255.76.67:7667?ttl=0");
    assert_int_equal(config->lcm.period.ns, 1000000000);
    assert_int_equal(config->lcm.events, 1u << CW_EVENT_ERROR | 1u << CW_EVENT_STATE |
                                             1u << CW_EVENT_RESTART | 1u << CW_EVENT_OVERLOAD |
                                             1u << CW_EVENT_DROP | 1u << CW_EVENT_FAULT);
    cfg_free(config);
}

static void ports_are_read(void **state)
{
    (void)state;
    static const char *const ports[] = {"vcan0", "unix:/run/rig/absolute.sock",
                                        "unix:" GOOD "run/a relative.sock", "fd:3", "fd:10"};
    cfg *config = load_good(GOOD "ports.yaml");
    assert_int_equal(config->node_count, 5);
    for (unsigned i = 0; i < 5; i++)
        assert_string_equal(config->nodes[i].port, ports[i]);
    assert_int_equal(config->pacing, CFG_PACING_SPIN);
    for (unsigned i = 0; i < 5; i++) { /* the first is an interface, the others are sockets */
        assert_int_equal(config->nodes[i].queue, i == 0 ? 1024 : 16);
        assert_int_equal(config->nodes[i].when_full,
                         i == 0 ? CFG_WHEN_FULL_DROP : CFG_WHEN_FULL_WAIT);
    }
    cfg_free(config);
}

/* The head of the file has a line "# warns: LINE:COLUMN: message" for each. */
static void times_that_are_rounded_are_told(void **state)
{
    static const char path[] = GOOD "rounded.yaml";
    char wanted[LINE_SIZE];
    cfg *config = load_good(path);
    FILE *file = fopen(path, "r");
    const char *rest = config->warnings;
    (void)state;
    assert_non_null(file);
    while (fgets(wanted, sizeof wanted, file) && strncmp(wanted, "# warns: ", 9) == 0) {
        char line[LINE_SIZE];
        unsigned at;
        unsigned column;
        int place = 0;
        assert_int_equal(sscanf(wanted + 9, "%u:%u: %n", &at, &column, &place), 2);
        int length =
            snprintf(line, sizeof line, "%s:%u:%u: warning: %s", path, at, column,
                     wanted + 9 + place);
        if (strncmp(rest, line, (size_t)length) != 0)
            fail_msg("wanted %sgot %s", line, rest);
        rest += length;
    }
    assert_string_equal(rest, "");
    assert_true(rest - config->warnings > 1000);
    fclose(file);
    cfg_free(config);
    config = load_good(GOOD "full.yaml");
    assert_string_equal(config->warnings, "");
    cfg_free(config);
}

static void ports_have_peers_by_one_key(void **state)
{
    static const char *const peers[] = {"engine", "can0", "can0", NULL, NULL};
    (void)state;
    cfg *config = load_good(GOOD "vxcan.yaml");
    assert_true(config->vxcan);
    for (unsigned i = 0; i < 5; i++) {
        if (peers[i])
            assert_string_equal(config->nodes[i].peer, peers[i]);
        else
            assert_null(config->nodes[i].peer);
    }
    assert_null(config->nodes[1].netns);
    assert_string_equal(config->nodes[2].netns, "dash");
    cfg_free(config);
}

static void bus_keys_are_read(void **state)
{
    cfg *config = load_good(GOOD "full.yaml");

    (void)state;
    assert_string_equal(config->bus_name, "power_train.1");
    assert_int_equal(config->bitrate_bps, 125000);
    assert_int_equal(config->bit_ticks, 640);
    assert_true(config->seed == UINT64_MAX);
    assert_string_equal(config->lcm.url, "memq://");
    assert_int_equal(config->lcm.period.ns, 250000000);
    assert_int_equal(config->lcm.events,
                     1u << CW_EVENT_TX | 1u << CW_EVENT_RX | 1u << CW_EVENT_ARBITRATION_LOST);
    assert_string_equal(config->control, GOOD "run/bus.sock");
    assert_int_equal(config->pacing, CFG_PACING_TICK);
    assert_int_equal(config->missing_port, CFG_MISSING_PORT_WAIT);
    assert_int_equal(config->catch_up.ns, 250000000);
    cfg_free(config);
}

static void node_keys_are_read(void **state)
{
    cfg *config = load_good(GOOD "full.yaml");
    const cfg_node *engine = &config->nodes[0];
    const cfg_node *gearbox = &config->nodes[1];

    (void)state;
    assert_int_equal(config->node_count, 3);
    assert_string_equal(engine->name, "engine");
    assert_string_equal(engine->port, "vcan0");
    assert_null(engine->peer);
    assert_int_equal(engine->restart_ms, 100);
    assert_true(engine->berr_reporting);
    assert_int_equal(engine->modes, CW_MODE_ONE_SHOT | CW_MODE_LISTEN_ONLY | CW_MODE_LOOPBACK |
                                        CW_MODE_PRESUME_ACK | CW_MODE_BERR_REPORTING |
                                        CW_MODE_LOST_ARBITRATION_REPORTING);
    assert_int_equal(engine->queue, 4096);
    assert_int_equal(engine->when_full, CFG_WHEN_FULL_WAIT);
    assert_int_equal(gearbox->when_full, CFG_WHEN_FULL_DROP);
    assert_int_equal(gearbox->queue, 1024);
    assert_int_equal(engine->order, CW_ORDER_FIFO);
    assert_int_equal(engine->warning_limit, 255);
    assert_string_equal(gearbox->port, "vxcan1");
    assert_string_equal(gearbox->peer, "can0");
    assert_string_equal(gearbox->netns, "gearbox");
    assert_int_equal(gearbox->modes, 0);
    assert_false(gearbox->berr_reporting);
    assert_int_equal(gearbox->warning_limit, 1);
    cfg_free(config);
}

static void nodes_have_defaults_and_may_say_otherwise(void **state)
{
    static const unsigned modes = CW_MODE_ONE_SHOT | CW_MODE_PRESUME_ACK |
                                  CW_MODE_BERR_REPORTING | CW_MODE_LOST_ARBITRATION_REPORTING;
    cfg *config = load_good(GOOD "defaults.yaml");
    const cfg_node *all = &config->nodes[0];
    const cfg_node *own = &config->nodes[1];
    const cfg_node *interface = &config->nodes[2];
    const cfg_node *socket = &config->nodes[3];

    (void)state;
    assert_int_equal(all->restart_ms, 100);
    assert_int_equal(all->modes, modes);
    assert_true(all->berr_reporting);
    assert_int_equal(all->queue, 64);
    assert_int_equal(all->when_full, CFG_WHEN_FULL_DROP); /* it has no port */
    assert_int_equal(all->order, CW_ORDER_FIFO);
    assert_int_equal(all->warning_limit, 90);
    assert_int_equal(own->restart_ms, 0);
    assert_int_equal(own->modes, modes & ~(unsigned)CW_MODE_ONE_SHOT);
    assert_int_equal(own->queue, 3);
    assert_int_equal(own->order, CW_ORDER_PRIORITY);
    assert_int_equal(own->warning_limit, 96);
    assert_int_equal(interface->queue, 64); /* not what an interface has by itself */
    assert_int_equal(interface->when_full, CFG_WHEN_FULL_WAIT);
    assert_int_equal(socket->when_full, CFG_WHEN_FULL_DROP);
    assert_false(socket->berr_reporting);
    assert_int_equal(config->nodes[4].queue, 7);
    cfg_free(config);
}

static void traffic_is_read(void **state)
{
    cfg *config = load_good(GOOD "full.yaml");
    const cfg_node *load = &config->nodes[2];
    const cfg_traffic *t = load->traffic;

    (void)state;
    assert_int_equal(load->traffic_count, 4);
    assert_int_equal(t[0].frame.id, 0x123);
    assert_int_equal(t[0].every.ns, 10000000);
    assert_int_equal(t[0].offset.ns, 1000000);
    assert_int_equal(t[0].count, 100);
    assert_true(t[0].has_every);
    assert_int_equal(t[1].frame.dlc, 15);
    assert_int_equal(t[1].every.bits, 100);
    assert_true(t[1].count == UINT64_MAX);
    assert_false(t[2].has_every);
    assert_int_equal(t[2].count, 1);
    assert_int_equal(t[2].offset.ns, 2000000000);
    assert_int_equal(t[3].count, 1);
    cfg_free(config);
}

static void jitter_replays_and_replies_are_read(void **state)
{
    cfg *config = load_good(GOOD "traffic.yaml");
    const cfg_traffic *t = config->nodes[0].traffic;

    (void)state;
    assert_int_equal(t[0].kind, CFG_TRAFFIC_SEND);
    assert_int_equal(t[0].jitter.ns, 10000000);
    assert_int_equal(t[2].jitter.ns, 0);
    assert_true(cfg_traffic_is_endless(&t[2]));
    assert_false(cfg_traffic_is_endless(&t[0]));
    t = config->nodes[1].traffic;
    assert_int_equal(t[0].kind, CFG_TRAFFIC_REPLAY);
    assert_string_equal(t[0].file, GOOD "../../traces/candump/log.log");
    assert_int_equal(t[0].format, TRACE_DETECT);
    assert_int_equal(t[0].filter_count, 1);
    assert_int_equal(t[0].filters[0].mask, 0x700);
    assert_int_equal(t[0].count, 1);
    assert_false(t[0].fast);
    assert_null(t[0].channel);
    assert_int_equal(t[0].gap.ns, 1000000);
    assert_int_equal(t[1].format, TRACE_CANDUMP_DELTA);
    assert_int_equal(t[1].filter_count, 3);
    assert_true(t[1].filters[2].inverted);
    assert_string_equal(t[1].channel, "can-log1");
    assert_int_equal(t[1].offset.ns, 1000000000);
    assert_int_equal(t[1].count, 3);
    assert_int_equal(t[1].gap.ns, 20000000);
    assert_true(t[2].fast);
    assert_true(cfg_traffic_is_endless(&t[2]));
    assert_string_equal(t[3].channel, "1");
    t = config->nodes[2].traffic;
    assert_int_equal(config->reply_count, 3);
    assert_int_equal(t[0].kind, CFG_TRAFFIC_REPLY);
    assert_int_equal(t[0].filters[0].value, 0x123 | CW_FILTER_REMOTE);
    assert_int_equal(t[0].filters[0].mask, 0x7FF | CW_FILTER_REMOTE | CW_FILTER_EXTENDED);
    assert_false(cfg_traffic_is_endless(&t[0]));
    assert_int_equal(t[1].delay.ns, 250000);
    assert_int_equal(t[1].count, 4294967295);
    assert_int_equal(t[2].filter_count, 4);
    cfg_free(config);
}

static void recordings_are_read(void **state)
{
    static const cfg_record expected[] = {
        {.format = CFG_RECORD_CANDUMP, .size = 100000000, .files = 5},
        {.format = CFG_RECORD_PCAPNG, .size = 64000, .files = 1},
        {.format = CFG_RECORD_VCD, .size = UINT64_C(1000000000000), .files = 1000},
        {.format = CFG_RECORD_CANDUMP, .size = 100000, .files = 5},
    };
    cfg *config = load_good(GOOD "full.yaml");

    (void)state;
    assert_int_equal(config->record_count, 4);
    assert_string_equal(config->records[0].file, GOOD "drive.log");
    assert_string_equal(config->records[1].file, "/tmp/drive.pcapng");
    for (size_t i = 0; i < 4; i++) {
        assert_int_equal(config->records[i].format, expected[i].format);
        assert_int_equal(config->records[i].size, expected[i].size);
        assert_int_equal(config->records[i].files, expected[i].files);
    }
    cfg_free(config);
}

static void rules_are_read(void **state)
{
    cfg *config = load_good(GOOD "full.yaml");
    const cw_rule *r = config->rules;

    (void)state;
    assert_int_equal(config->rule_count, 3);
    assert_string_equal(r[0].name, "crc-flip");
    assert_int_equal(r[0].filter_count, 1);
    assert_int_equal(r[0].filters[0].mask, 0x800007FF);
    assert_int_equal(r[0].from, 1);
    assert_int_equal(r[0].time_begin, 2 * TICKS_PER_S);
    assert_int_equal(r[0].time_end, 5 * TICKS_PER_S);
    assert_int_equal(r[0].skip, 3);
    assert_int_equal(r[0].every, 10);
    assert_int_equal(r[0].count, 5);
    assert_true(r[0].probability == UINT64_C(1) << 63);
    assert_int_equal(r[0].action, CW_ACTION_FLIP);
    assert_int_equal(r[0].field, CW_FIELD_CRC);
    assert_int_equal(r[0].index, 3);
    assert_int_equal(r[0].bits, 2);
    assert_int_equal(r[0].at, 6);
    assert_int_equal(r[1].filter_count, 3);
    assert_int_equal(r[1].from, 5);
    assert_int_equal(r[1].time_begin, 64000);
    assert_true(r[1].time_end == CW_NEVER);
    assert_int_equal(r[1].index, 63);
    assert_int_equal(r[1].at, 1);
    cfg_free(config);
}

static void rule_defaults_act_always(void **state)
{
    cfg *config = load_good(GOOD "full.yaml");
    const cw_rule *rule = &config->rules[2];

    (void)state;
    assert_int_equal(rule->filter_count, 0);
    assert_int_equal(rule->from, 0);
    assert_int_equal(rule->time_begin, 0);
    assert_true(rule->time_end == CW_NEVER);
    assert_int_equal(rule->skip, 0);
    assert_int_equal(rule->every, 1);
    assert_int_equal(rule->count, 0);
    assert_true(rule->probability == UINT64_MAX);
    assert_int_equal(rule->bits, 1);
    assert_int_equal(rule->at, 0);
    cfg_free(config);
}

static void expectations_are_read(void **state)
{
    cfg *config = load_good(GOOD "expect.yaml");
    const cfg_expect *e = config->expects;

    (void)state;
    assert_int_equal(config->expect_count, 18);
    for (size_t i = 0; i < config->expect_count; i++)
        assert_int_equal(e[i].line, 11 + (int)i);
    assert_string_equal(e[0].name, "speed, everywhere");
    assert_int_equal(e[0].kind, CFG_EXPECT_DELIVERED);
    assert_int_equal(e[0].min, 10);
    assert_int_equal(e[0].max, 20);
    assert_int_equal(e[0].when.filter_count, 2);
    assert_int_equal(e[0].when.data_length, 2);
    assert_int_equal(e[0].when.from, 1);
    assert_int_equal(e[0].to, 6);
    assert_int_equal(e[0].when.time_begin, TICKS_PER_S);
    assert_int_equal(e[0].when.time_end, 2 * TICKS_PER_S);
    assert_null(e[1].name);
    assert_int_equal(e[1].max, 0);
    assert_true(e[1].when.time_end == CW_NEVER);
    assert_int_equal(e[2].min, 1);
    assert_true(e[2].max == UINT64_MAX);
    assert_true(e[3].min == UINT64_MAX);
    assert_int_equal(e[4].kind, CFG_EXPECT_DELAY);
    assert_int_equal(e[4].delay_max, 400000);
    assert_true(e[4].percentile[CFG_P99] == CW_NEVER);
    assert_int_equal(e[5].delay_max, 16000);
    assert_int_equal(e[5].percentile[CFG_P50], 80);
    assert_int_equal(e[5].percentile[CFG_P90], 160);
    assert_int_equal(e[5].percentile[CFG_P95], 240);
    assert_int_equal(e[5].percentile[CFG_P99], 320);
    assert_int_equal(e[6].kind, CFG_EXPECT_SEEN);
    assert_false(e[6].never);
    assert_int_equal(e[6].when.time_end, TICKS_PER_S / 100);
    assert_true(e[7].never);
    assert_int_equal(e[8].kind, CFG_EXPECT_STATE);
    assert_int_equal(e[8].states, 1u << CW_STATE_BUS_OFF);
    assert_int_equal(e[8].node, 1);
    assert_true(e[8].never);
    assert_int_equal(e[9].states, 1u << CW_STATE_ERROR_PASSIVE | 1u << CW_STATE_BUS_OFF);
    assert_int_equal(e[9].when.time_begin, 2 * TICKS_PER_S);
    assert_int_equal(e[10].kind, CFG_EXPECT_ERRORS);
    assert_int_equal(e[10].types, 1u << CW_ERROR_CRC | 1u << CW_ERROR_STUFF);
    assert_int_equal(e[11].why, 1u << CW_DROP_QUEUE_FULL | 1u << CW_DROP_REMOVED);
    for (unsigned i = 0; i < 4; i++)
        assert_int_equal(e[11 + i].kind, CFG_EXPECT_DROPS + i);
    assert_int_equal(e[15].kind, CFG_EXPECT_FAULTS);
    assert_string_equal(e[15].rule, "crc-flip");
    assert_int_equal(e[16].kind, CFG_EXPECT_LOAD);
    assert_int_equal(e[16].min, 125);
    assert_int_equal(e[16].max, 600);
    assert_string_equal(e[17].name, "7");
    cfg_free(config);
}

/* The texts of all files are kept, and the configuration can be made of them alone. */
static void files_are_kept_and_can_be_given(void **state)
{
    cfg *config = load_good(GOOD "profiles.yaml");
    cfg_file renamed[8];
    char *errors = NULL;
    size_t length = 0;

    (void)state;
    assert_in_range(config->file_count, 2, COUNT(renamed));
    assert_string_equal(config->files[0].name, GOOD "profiles.yaml");
    for (size_t i = 0; i < config->file_count; i++)
        renamed[i] = (cfg_file){.name = config->files[i].name,
                                .text = config->files[i].text,
                                .size = config->files[i].size};
    assert_non_null(strstr(renamed[0].text, "profiles:"));
    cfg *again = cfg_load_given(renamed, config->file_count, stderr);
    assert_non_null(again);
    assert_int_equal(again->rule_count, config->rule_count);
    assert_int_equal(again->file_count, config->file_count);
    FILE *out = open_memstream(&errors, &length);
    assert_null(cfg_load_given(renamed, 1, out)); /* though the others are there */
    fclose(out);
    assert_non_null(strstr(errors, "this file is not among those that are given"));
    free(errors);
    cfg_free(again);
    cfg_free(config);
}

static void files_of_traffic_need_not_be_there_when_files_are_given(void **state)
{
    static const char text[] = "bus: { bitrate: 500000 }\n"
                               "nodes: [ { name: a, traffic: [ { replay: nowhere.log } ] } ]\n";
    const cfg_file file = {.name = "bus.yaml", .text = text, .size = sizeof text - 1};

    (void)state;
    cfg *config = cfg_load_given(&file, 1, stderr);
    assert_non_null(config);
    assert_int_equal(config->nodes[0].traffic_count, 1);
    cfg_free(config);
}

static void nodes_are_matched_by_name(void **state)
{
    cfg *full = load_good(GOOD "full.yaml");
    cfg *small = load_good(GOOD "expect.yaml");
    uint8_t from[CW_NODES_MAX];

    (void)state;
    cfg_match_nodes(from, small, full); /* engine, gearbox, dash of engine, gearbox, load */
    assert_int_equal(from[0], 0);
    assert_int_equal(from[1], 1);
    for (size_t i = 2; i < CW_NODES_MAX; i++)
        assert_int_equal(from[i], CW_NO_NODE);
    cfg_free(full);
    cfg_free(small);
}

/* The rule of that name. */
static const cw_rule *rule_of(const cfg *config, const char *name)
{
    for (size_t i = 0; i < config->rule_count; i++)
        if (strcmp(config->rules[i].name, name) == 0)
            return &config->rules[i];
    fail_msg("no rule %s", name);
    return NULL;
}

static void rules_wait_for_what_is_written(void **state)
{
    static const struct {
        const char *name;
        cw_trigger trigger;
        uint64_t begin;
        uint64_t end;
    } cases[] = {
        {"list", CW_TRIGGER_FRAME, 0, CW_NEVER},
        {"errors", CW_TRIGGER_ERROR, 0, CW_NEVER},
        {"states", CW_TRIGGER_TIME, 0, CW_NEVER},
        {"sequence", CW_TRIGGER_ARMED, 0, CW_NEVER},
        {"by-hand", CW_TRIGGER_ARMED, 0, CW_NEVER},
        {"moment", CW_TRIGGER_TIME, 2 * TICKS_PER_S, CW_NEVER},
        {"until", CW_TRIGGER_FRAME, 0, 5 * TICKS_PER_S},
        {"armed-frame", CW_TRIGGER_FRAME, 0, CW_NEVER},
        {"force-bits", CW_TRIGGER_FRAME, 0, CW_NEVER},
        {"stuck-wire", CW_TRIGGER_TIME, TICKS_PER_S, 2 * TICKS_PER_S},
        {"wrong-crc-alone", CW_TRIGGER_FRAME, 0, CW_NEVER},
        {"overload", CW_TRIGGER_FRAME, 0, CW_NEVER},
        {"drop-rx", CW_TRIGGER_FRAME, 0, CW_NEVER},
        {"delay", CW_TRIGGER_FRAME, 0, CW_NEVER},
        {"send", CW_TRIGGER_TIME, 0, CW_NEVER},
        {"reply", CW_TRIGGER_FRAME, 0, CW_NEVER},
    };
    cfg *config = load_good(GOOD "faults.yaml");

    (void)state;
    for (size_t i = 0; i < COUNT(cases); i++) {
        const cw_rule *rule = rule_of(config, cases[i].name);

        if (rule->trigger != cases[i].trigger)
            fail_msg("%s: trigger %d", cases[i].name, (int)rule->trigger);
        assert_true(rule->time_begin == cases[i].begin && rule->time_end == cases[i].end);
    }
    cfg_free(config);
}

static void conditions_are_read(void **state)
{
    cfg *config = load_good(GOOD "faults.yaml");
    const cw_rule *list = rule_of(config, "list");
    const cw_rule *errors = rule_of(config, "errors");
    const cw_rule *states = rule_of(config, "states");
    const cw_rule *sequence = rule_of(config, "sequence");

    (void)state;
    assert_int_equal(list->filter_count, 3);
    assert_int_equal(list->filters[1].value, 0x456);
    assert_true(list->filters[2].inverted);
    assert_int_equal(list->data_length, 3);
    assert_memory_equal(list->data_mask, "\xFF\xFF\x0F", 3);
    assert_memory_equal(list->data_value, "\xDE\xAD\x01", 3);
    assert_int_equal(list->hold_off, 400000);
    assert_int_equal(errors->error_mask, 0xC);
    assert_int_equal(errors->filter_count, 0);
    assert_int_equal(errors->from, 2);
    assert_int_equal(states->state_nodes, 3);
    assert_int_equal(states->state_mask, 1u << CW_STATE_ERROR_PASSIVE | 1u << CW_STATE_BUS_OFF);
    assert_true(sequence->has_after);
    assert_string_equal(config->rules[sequence->after].name, "by-hand");
    assert_int_equal(sequence->after_delay, 20 * 160);
    assert_true(rule_of(config, "by-hand")->manual);
    assert_true(rule_of(config, "armed-frame")->has_after);
    cfg_free(config);
}

static void actions_on_bits_are_read(void **state)
{
    cfg *config = load_good(GOOD "faults.yaml");
    const cw_rule *bits = rule_of(config, "force-bits");
    const cw_rule *time = rule_of(config, "force-time");
    const cw_rule *glitch = rule_of(config, "glitch");

    (void)state;
    assert_int_equal(bits->action, CW_ACTION_FORCE);
    assert_true(bits->level == CW_DOMINANT);
    assert_int_equal(bits->field, CW_FIELD_DATA);
    assert_int_equal(bits->index, 8);
    assert_int_equal(bits->bits, 12);
    assert_int_equal(bits->for_ticks, 0);
    assert_int_equal(bits->at, 6);
    assert_true(time->level == CW_RECESSIVE);
    assert_int_equal(time->for_ticks, 80000);
    assert_int_equal(glitch->action, CW_ACTION_GLITCH);
    assert_int_equal(glitch->bits, 4);
    assert_int_equal(glitch->pattern_level, 9);
    assert_int_equal(glitch->pattern_mask, 11);
    assert_int_equal(glitch->field, CW_FIELD_STUFF);
    assert_int_equal(rule_of(config, "glitch-unquoted")->pattern_level, 6);
    cfg_free(config);
}

static void lasting_actions_are_read(void **state)
{
    cfg *config = load_good(GOOD "faults.yaml");
    const cw_rule *wire = rule_of(config, "stuck-wire");
    const cw_rule *tx = rule_of(config, "stuck-tx");
    const cw_rule *rx = rule_of(config, "stuck-rx");
    const cw_rule *noise = rule_of(config, "noise");
    const cw_rule *groups = rule_of(config, "partition");

    (void)state;
    assert_int_equal(wire->action, CW_ACTION_STUCK);
    assert_int_equal(wire->line, CW_LINE_WIRE);
    assert_int_equal(wire->for_ticks, 0); /* the window ends it */
    assert_int_equal(tx->line, CW_LINE_TX);
    assert_int_equal(tx->node, 0);
    assert_int_equal(tx->for_ticks, 8000000);
    assert_int_equal(tx->dominant_timeout, 160000);
    assert_int_equal(rx->line, CW_LINE_RX);
    assert_int_equal(rx->node, 2);
    assert_true(rx->level == CW_RECESSIVE);
    assert_int_equal(rule_of(config, "stuck-node-called-wire")->node, 3);
    assert_true(noise->error_rate == UINT64_C(184467440737095));
    assert_int_equal(noise->at, 1);
    assert_true(rule_of(config, "noise-always")->error_rate == UINT64_MAX);
    assert_int_equal(rule_of(config, "no-ack")->nodes, 6);
    assert_int_equal(rule_of(config, "disconnect")->nodes, 3);
    assert_memory_equal(groups->group, "\0\0\1\2", 4);
    cfg_free(config);
}

static void controller_actions_are_read(void **state)
{
    cfg *config = load_good(GOOD "faults.yaml");
    const cw_rule *moment = rule_of(config, "moment");
    const cw_rule *until = rule_of(config, "until");
    const cw_rule *crc = rule_of(config, "wrong-crc");
    const cw_settings *set = &rule_of(config, "set-all")->settings;

    (void)state;
    assert_int_equal(moment->tec, 255);
    assert_int_equal(moment->rec, CW_KEEP);
    assert_int_equal(until->nodes, 5);
    assert_int_equal(until->tec, 0);
    assert_int_equal(until->rec, 127);
    assert_int_equal(rule_of(config, "by-hand")->number, 2);
    assert_int_equal(rule_of(config, "overload")->number, 1);
    assert_int_equal(crc->nodes, 1);
    assert_int_equal(crc->from, 1); /* only its own frames are matches */
    assert_int_equal(rule_of(config, "wrong-crc-alone")->from, 3);
    assert_int_equal(set->which,
                     CW_SET_MODES | CW_SET_RESTART | CW_SET_QUEUE | CW_SET_ORDER | CW_SET_WARNING);
    assert_int_equal(set->modes_mask, 0x3F);
    assert_int_equal(set->modes, CW_MODE_ONE_SHOT | CW_MODE_PRESUME_ACK |
                                     CW_MODE_BERR_REPORTING |
                                     CW_MODE_LOST_ARBITRATION_REPORTING);
    assert_int_equal(set->restart_ticks, 8000000);
    assert_int_equal(set->queue, 32);
    assert_int_equal(set->order, CW_ORDER_FIFO);
    assert_int_equal(set->warning_limit, 10);
    cfg_free(config);
}

static void host_actions_are_read(void **state)
{
    cfg *config = load_good(GOOD "faults.yaml");
    const cw_change *change = &rule_of(config, "change")->change;

    (void)state;
    assert_int_equal(rule_of(config, "drop-tx")->side, CW_SIDE_TX);
    assert_int_equal(rule_of(config, "drop-rx")->side, CW_SIDE_RX);
    assert_int_equal(rule_of(config, "delay")->side, CW_SIDE_TX);
    assert_int_equal(rule_of(config, "delay")->for_ticks, 400000);
    assert_int_equal(rule_of(config, "duplicate")->side, CW_SIDE_RX);
    assert_int_equal(rule_of(config, "duplicate")->number, 2);
    assert_int_equal(rule_of(config, "reorder")->side, CW_SIDE_RX);
    assert_true(change->set_id && change->set_dlc);
    assert_int_equal(change->id, 0x12345678);
    assert_int_equal(change->id_flags, CW_FRAME_EXTENDED);
    assert_int_equal(change->dlc, 15);
    assert_memory_equal(change->set_mask, "\x0F\x00\xFF\x00\x00\x00\x00\x00", 8);
    assert_memory_equal(change->set, "\x01\x00\xFF\x00\x00\x00\x00\x00", 8);
    assert_memory_equal(change->and_mask, "\x0F\xFF\xFF\xFF\xFF\xFF\xFF\xFF", 8);
    assert_memory_equal(change->or_mask, "\x00\x10\x00\x00\x00\x00\x00\x00", 8);
    assert_memory_equal(change->xor_mask, "\xFF\x00\x00\x00\x00\x00\x00\x00", 8);
    cfg_free(config);
}

static void traffic_actions_are_read(void **state)
{
    cfg *config = load_good(GOOD "faults.yaml");
    const cw_rule *send = rule_of(config, "send");
    const cw_rule *burst = rule_of(config, "burst");
    const cw_rule *reply = rule_of(config, "reply");

    (void)state;
    assert_int_equal(send->frame.id, 0x123);
    assert_int_equal(send->node, 1);
    assert_int_equal(send->period_ticks, 0);
    assert_int_equal(burst->period_ticks, 800000);
    assert_int_equal(burst->time_end, 2 * TICKS_PER_S);
    assert_int_equal(rule_of(config, "babble")->for_ticks, 4000000);
    assert_int_equal(rule_of(config, "load")->load_permille, 625);
    assert_int_equal(rule_of(config, "load")->node, 2);
    assert_int_equal(reply->for_ticks, 80000);
    assert_int_equal(reply->filters[0].mask, 0xC00007FF);
    cfg_free(config);
}

static void profiles_take_parameters(void **state)
{
    cfg *config = load_good(GOOD "profiles.yaml");
    const cw_rule *r = config->rules;

    (void)state;
    assert_int_equal(config->rule_count, 6);
    assert_string_equal(r[0].name, "costs");
    assert_string_equal(r[1].name, "first");
    assert_int_equal(r[1].from, 1);
    assert_int_equal(r[1].at, 2);
    assert_int_equal(r[1].time_begin, TICKS_PER_S);
    assert_int_equal(r[2].after, 1);
    assert_int_equal(r[2].node, 0);
    assert_string_equal(r[3].name, "again.first");
    assert_int_equal(r[3].from, 2);
    assert_int_equal(r[3].at, 1);
    assert_int_equal(r[3].time_begin, TICKS_PER_S * 3 / 2);
    assert_string_equal(r[4].name, "again.second");
    assert_int_equal(r[4].after, 3);
    assert_string_equal(r[5].name, "own");
    assert_int_equal(r[5].after, 4);
    cfg_free(config);
}

/* Rules from a text against config/profiles.yaml; on errors NULL, and *errors is what was said. */
static cfg_rules *inject(char **errors, const char *text, const cfg_running *running)
{
    cfg *config = load_good(GOOD "profiles.yaml");
    size_t length;
    FILE *out = open_memstream(errors, &length);
    cfg_rules *rules = cfg_load_rules(text, strlen(text), "text", config, running, out);

    fclose(out);
    assert_true((rules == NULL) == (length > 0));
    cfg_free(config); /* the rules do not need it any more */
    return rules;
}

static void rules_are_read_from_texts(void **state)
{
    static const char *const texts[] = {
        "{ name: x, do: { bus-off: engine } }",
        "{\"name\": \"x\", \"do\": {\"bus-off\": [\"engine\"]}}",
        "- { name: x, do: { bus-off: engine } }",
        "faults: [{ name: x, do: { bus-off: engine } }]",
        "{ parameters: { v: }, with: { v: engine }, faults: [{ name: x, do: { bus-off: $v } }] }",
        "{ parameters: { v: engine }, faults: [{ name: x, do: { bus-off: $v } }] }",
    };
    (void)state;
    for (size_t i = 0; i < COUNT(texts); i++) {
        char *errors;
        cfg_rules *rules = inject(&errors, texts[i], NULL);

        if (!rules)
            fail_msg("%s", errors);
        assert_int_equal(rules->count, 1);
        assert_string_equal(rules->rules[0].name, "x");
        assert_int_equal(rules->rules[0].nodes, 1);
        cfg_free_rules(rules);
        free(errors);
    }
}

static void bad_texts_are_refused(void **state)
{
    static const struct {
        const char *text;
        const char *error;
    } cases[] = {
        {"", "text:1:1: there is no rule"},
        {"x", "text:1:1: expected a rule"},
        {"{ bus: { bitrate: 1 } }", "text:1:1: expected a rule"},
        {"{ name: x", "text:"},
        {"{ name: x }", "text:1:1: rule: the key 'do' is missing"},
        {"{ name: own, do: { flip: sof } }", "text:1:9: a rule 'own' is running already"},
        {"{ name: x, do: { bus-off: none } }", "text:1:27: bus-off: there is no node 'none'"},
        {"{ name: x, do: { flip: sof }, when: { after: { rule: y } } }",
         "text:1:54: rule: there is no rule 'y'"},
        {"{ parameters: { v: }, faults: [{ name: x, do: { bus-off: $v } }] }",
         "text:1:1: with: the parameter 'v' of the profile needs a value"},
        {"[{ name: x, do: { flip: sof }, when: { after: { rule: y } } },"
         " { name: y, do: { flip: sof }, when: { after: { rule: x } } }]",
         "text: there are rules that come after each other in a circle"},
    };
    (void)state;
    for (size_t i = 0; i < COUNT(cases); i++) {
        char *errors;

        assert_null(inject(&errors, cases[i].text, NULL));
        if (strncmp(errors, cases[i].error, strlen(cases[i].error)) != 0)
            fail_msg("expected %s\ngot %s", cases[i].error, errors);
        free(errors);
    }
}

/* What comes after a later rule is moved behind it; running rules keep their index. */
static void injected_rules_come_in_an_order_that_can_be_added(void **state)
{
    static const char text[] =
        "- { name: a, do: { flip: sof }, when: { after: { rule: b } } }\n"
        "- { name: b, do: { flip: sof }, when: { after: { rule: c } } }\n"
        "- { name: c, do: { flip: sof } }\n"
        "- { name: d, do: { flip: sof }, when: { after: { rule: live } } }\n";
    static const char *const names[] = {NULL, "other", "live"};
    static const cfg_running running = {.count = COUNT(names), .names = names};
    static const char *const order[] = {"c", "d", "b", "a"};
    static const unsigned after[] = {0, 2, 3, 5};
    char *errors;
    cfg_rules *rules = inject(&errors, text, &running);

    (void)state;
    assert_non_null(rules);
    assert_int_equal(rules->count, COUNT(order));
    for (size_t i = 0; i < COUNT(order); i++) {
        assert_string_equal(rules->rules[i].name, order[i]);
        assert_int_equal(rules->rules[i].has_after, i > 0);
        assert_int_equal(rules->rules[i].after, after[i]);
    }
    cfg_free_rules(rules);
    free(errors);
}

static void a_profile_is_no_configuration(void **state)
{
    static const char path[] = "tests/config/profiles/two-rules.yaml";
    char *text;
    size_t length;
    FILE *out = open_memstream(&text, &length);

    (void)state;
    assert_null(cfg_load(path, out));
    fclose(out);
    assert_non_null(strstr(text, ":1:1: this is a fault profile"));
    free(text);
}

static void aliases_stand_for_their_values(void **state)
{
    cfg *config = load_good(GOOD "aliases.yaml");

    (void)state;
    assert_int_equal(config->nodes[1].restart_ms, 100);
    assert_int_equal(config->nodes[2].traffic[1].frame.id, 0x100);
    assert_int_equal(config->rules[1].time_end, TICKS_PER_S);
    assert_int_equal(config->rules[1].field, CW_FIELD_CRC);
    cfg_free(config);
}

static void bus_config_is_usable(void **state)
{
    static const char *const files[] = {GOOD "full.yaml", GOOD "minimal.yaml"};

    (void)state;
    for (size_t i = 0; i < COUNT(files); i++) {
        cfg *config = load_good(files[i]);
        cw_node_config nodes[CW_NODES_MAX];
        cw_bus_config bus;

        cfg_bus_config(&bus, nodes, config);
        assert_int_equal(bus.bit_ticks, config->bit_ticks);
        assert_int_equal(bus.node_count, config->node_count);
        assert_int_equal(bus.rule_count, config->rule_count);
        assert_int_equal(nodes[0].restart_ticks, config->nodes[0].restart_ms * UINT64_C(80000));
        assert_int_equal(nodes[0].queue, config->nodes[0].queue);
        assert_true(cw_bus_size(&bus) > 0);
        cfg_free(config);
    }
}

/* A file with this content; removed and freed with drop_file(). */
static char *make_file(const void *content, size_t length)
{
    char *path = strdup("/tmp/test_config.XXXXXX");
    int fd = mkstemp(path);

    assert_int_not_equal(fd, -1);
    for (size_t done = 0; done < length;) {
        ssize_t written = write(fd, (const char *)content + done, length - done);

        assert_true(written > 0);
        done += (size_t)written;
    }
    close(fd);
    return path;
}

static void drop_file(char *path)
{
    unlink(path);
    free(path);
}

/* NULL when the content is accepted, else what is said after the path, to be freed. */
static char *errors_of_content(const void *content, size_t length)
{
    char *path = make_file(content, length);
    char *errors = errors_of(path);

    if (errors)
        memmove(errors, errors + strlen(path), strlen(errors + strlen(path)) + 1);
    drop_file(path);
    return errors;
}

static void expect_error(const void *content, size_t length, const char *expected)
{
    char *errors = errors_of_content(content, length);

    if (!errors || strncmp(errors, expected, strlen(expected)) != 0)
        fail_msg("expected %s\ngot %s", expected, errors ? errors : "no error");
    free(errors);
}

/* Errors alone are told of a bad file; and warnings do not take their places. */
static void warnings_take_no_place_of_errors(void **state)
{
    (void)state;
    char *text = NULL;
    size_t size = 0;
    char *path;
    unsigned lines = 0;
    FILE *out = open_memstream(&text, &size);
    fputs("bus: { bitrate: 500000 }\nnodes: [ { name: a } ]\nfaults:\n", out);
    for (unsigned i = 0; i < 300; i++)
        fprintf(out, "  - { name: r%u, do: { no-ack: a, for: 1us } }\n", i);
    fputs("seed: -1\n", out);
    fclose(out);
    path = make_file(text, size);
    char *errors = errors_of(path);
    assert_non_null(errors);
    for (const char *c = errors; *c; c++)
        lines += *c == '\n';
    assert_int_equal(lines, 1);
    assert_non_null(strstr(errors, ":304:7: seed: expected"));
    free(errors);
    free(text);
    drop_file(path);
}

static void bytes_that_are_no_text_are_refused(void **state)
{
    static const struct {
        const char *content;
        size_t length;
        const char *expected;
    } cases[] = {
        {BYTES(""), ":1:1: the file is empty"},
        {BYTES("\0"), ":1:1: NUL bytes"},
        {BYTES("# \xC3\xA4\nseed: \0"), ":2:7: NUL bytes"},
        {BYTES("seed: \xFF\n"), ":1:7: invalid leading UTF-8 octet"},
        {BYTES("# \xC3\xA4\n\xC3\xA4: \xE4\n"), ":2:4: incomplete UTF-8 octet sequence"},
        {BYTES("seed: \x01\n"), ":1:7: control characters"},
        {BYTES("\xFF\xFEs\0e\0"), ":1:4: NUL bytes"},
    };
    (void)state;
    for (size_t i = 0; i < COUNT(cases); i++)
        expect_error(cases[i].content, cases[i].length, cases[i].expected);
}

static void marks_and_line_ends_of_other_systems_are_accepted(void **state)
{
    static const char content[] = "\xEF\xBB\xBF"
                                  "bus: { bitrate: 500000 }\r\nnodes: [{ name: a }]\r\n";
    (void)state;
    assert_null(errors_of_content(content, sizeof content - 1));
}

static void what_is_no_file_is_refused(void **state)
{
    char *missing = errors_of("tests/config/none.yaml");
    char *directory = errors_of("tests/config");

    (void)state;
    assert_string_equal(missing,
                        "tests/config/none.yaml: No such file or directory\n");
    assert_string_equal(directory, "tests/config: cannot read: Is a directory\n");
    free(missing);
    free(directory);
}

/* A file of a pattern over and over, up to the size limit. */
static void expect_huge_error(const char *pattern, size_t length, const char *expected)
{
    char *content = malloc(length);
    size_t step = strlen(pattern);

    assert_non_null(content);
    for (size_t i = 0; i < length; i++)
        content[i] = pattern[i % step];
    expect_error(content, length, expected);
    free(content);
}

static void huge_files_end_soon(void **state)
{
    static const struct {
        const char *pattern;
        const char *expected;
    } cases[] = {
        {"#", ":1:1: the file is empty"},
        {"[", ":1:65: a file has at most 64 lists"},
        {"{", ":1:65: a file has at most 64 lists"},
        {"- ", ":1:"},
        {"? ", ":1:"},
        {"\n", ":1:1: the file is empty"},
        {"a: b\n", ":100000:4: a file has at most 200000 values"},
        {"- &a x\n", ":1001:3: a file has at most 1000 anchors"},
    };
    (void)state;
    for (size_t i = 0; i < COUNT(cases); i++)
        expect_huge_error(cases[i].pattern, YAML_FILE_MAX, cases[i].expected);
    expect_huge_error("#", YAML_FILE_MAX + 1, ": the file is larger than 4 MiB");
}

static void errors_without_end_are_cut(void **state)
{
    char content[400 * 8];
    size_t length = 0;
    unsigned lines = 0;

    (void)state;
    for (int i = 0; i < 400; i++)
        length += (size_t)sprintf(content + length, "k%d: 1\n", i);
    char *errors = errors_of_content(content, length);
    assert_non_null(errors);
    for (const char *c = errors; *c; c++)
        lines += *c == '\n';
    assert_int_equal(lines, DIAG_MAX + 1);
    assert_non_null(strstr(errors, "there are more errors"));
    free(errors);
}

/* A list of lists of lists: 9^40 values when expanded. */
static void aliases_are_not_expanded(void **state)
{
    char content[4096];
    size_t length = (size_t)sprintf(content, "a0: &a0 [x]\n");

    (void)state;
    for (int i = 1; i < 40; i++)
        length += (size_t)sprintf(content + length,
                                  "a%d: &a%d [*a%d, *a%d, *a%d, *a%d, *a%d, *a%d, *a%d]\n", i, i,
                                  i - 1, i - 1, i - 1, i - 1, i - 1, i - 1, i - 1);
    expect_error(content, length, ":1:1: configuration: unknown key 'a0'");
}

/* Exactly the rates within 0.1 % of 80 MHz / n are taken. */
static void bit_rates_are_near_what_the_clock_makes(void **state)
{
    static const struct {
        unsigned bitrate;
        unsigned ticks; /* 0: refused */
    } cases[] = {
        {5000, 16000}, {10000, 8000}, {33333, 2400}, {83333, 960}, {95238, 840},
        {250000, 320}, {615384, 130}, {615385, 130}, {799200, 0},  {800000, 100},
        {800799, 100}, {800801, 0},   {987654, 81},  {990000, 0},  {999000, 0},
        {999001, 80},  {1000000, 80}, {4999, 0},     {1000001, 0},
    };
    (void)state;
    for (size_t i = 0; i < COUNT(cases); i++) {
        char content[80];
        int length = snprintf(content, sizeof content, "bus: {bitrate: %u}\nnodes: [{name: a}]\n",
                              cases[i].bitrate);
        char *path = make_file(content, (size_t)length);
        FILE *nowhere = fopen("/dev/null", "w");
        cfg *config = cfg_load(path, nowhere);

        if ((config ? config->bit_ticks : 0) != cases[i].ticks)
            fail_msg("%u: %u ticks", cases[i].bitrate, config ? config->bit_ticks : 0);
        cfg_free(config);
        fclose(nowhere);
        drop_file(path);
    }
}

/* Exit status and standard output of canwire, which the environment names. */
static int run_tool(char *output, size_t size, const char *arguments)
{
    char command[PATH_SIZE];

    snprintf(command, sizeof command, "\"$CANWIRE\" %s 2>/dev/null", arguments);
    FILE *pipe = popen(command, "r");
    assert_non_null(pipe);
    output[fread(output, 1, size - 1, pipe)] = '\0';
    int status = pclose(pipe);
    assert_true(WIFEXITED(status));
    return WEXITSTATUS(status);
}

static void check_prints_a_summary_or_the_ports(void **state)
{
    static const struct {
        const char *arguments;
        int status;
        const char *output;
    } cases[] = {
        {"check config/example.yaml", 0,
         "config/example.yaml: ok (bus powertrain, 500000 bit/s, classical CAN, 3 nodes, "
         "0 rules)\n"},
        {"check " GOOD "minimal.yaml", 0,
         GOOD "minimal.yaml: ok (bus can, 500000 bit/s, classical CAN, 1 node, 0 rules)\n"},
        {"check --ports config/example.yaml", 0, "vcan0\nvcan1\nvcan2\n"},
        {"check --ports " GOOD "minimal.yaml", 0, ""},
        {"check --ports " BAD "names.yaml", 1, ""},
        {"check " BAD "names.yaml", 1, ""},
        {"check", 2, ""},
        {"check a b", 2, ""},
        {"check --nonsense a", 2, ""},
    };
    (void)state;
    if (!getenv("CANWIRE"))
        skip();
    for (size_t i = 0; i < COUNT(cases); i++) {
        char output[LINE_SIZE];

        assert_int_equal(run_tool(output, sizeof output, cases[i].arguments), cases[i].status);
        assert_string_equal(output, cases[i].output);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(good_files_are_accepted),
        cmocka_unit_test(bad_files_are_refused_with_all_errors),
        cmocka_unit_test(defaults_are_set),
        cmocka_unit_test(lcm_defaults_are_set),
        cmocka_unit_test(ports_are_read),
        cmocka_unit_test(times_that_are_rounded_are_told),
        cmocka_unit_test(warnings_take_no_place_of_errors),
        cmocka_unit_test(ports_have_peers_by_one_key),
        cmocka_unit_test(bus_keys_are_read),
        cmocka_unit_test(node_keys_are_read),
        cmocka_unit_test(nodes_have_defaults_and_may_say_otherwise),
        cmocka_unit_test(traffic_is_read),
        cmocka_unit_test(jitter_replays_and_replies_are_read),
        cmocka_unit_test(recordings_are_read),
        cmocka_unit_test(rules_are_read),
        cmocka_unit_test(rule_defaults_act_always),
        cmocka_unit_test(expectations_are_read),
        cmocka_unit_test(files_are_kept_and_can_be_given),
        cmocka_unit_test(files_of_traffic_need_not_be_there_when_files_are_given),
        cmocka_unit_test(nodes_are_matched_by_name),
        cmocka_unit_test(rules_wait_for_what_is_written),
        cmocka_unit_test(conditions_are_read),
        cmocka_unit_test(actions_on_bits_are_read),
        cmocka_unit_test(lasting_actions_are_read),
        cmocka_unit_test(controller_actions_are_read),
        cmocka_unit_test(host_actions_are_read),
        cmocka_unit_test(traffic_actions_are_read),
        cmocka_unit_test(profiles_take_parameters),
        cmocka_unit_test(rules_are_read_from_texts),
        cmocka_unit_test(bad_texts_are_refused),
        cmocka_unit_test(injected_rules_come_in_an_order_that_can_be_added),
        cmocka_unit_test(a_profile_is_no_configuration),
        cmocka_unit_test(aliases_stand_for_their_values),
        cmocka_unit_test(bus_config_is_usable),
        cmocka_unit_test(bytes_that_are_no_text_are_refused),
        cmocka_unit_test(marks_and_line_ends_of_other_systems_are_accepted),
        cmocka_unit_test(what_is_no_file_is_refused),
        cmocka_unit_test(huge_files_end_soon),
        cmocka_unit_test(errors_without_end_are_cut),
        cmocka_unit_test(aliases_are_not_expanded),
        cmocka_unit_test(bit_rates_are_near_what_the_clock_makes),
        cmocka_unit_test(check_prints_a_summary_or_the_ports),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
