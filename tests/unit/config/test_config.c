/* SPDX-License-Identifier: MIT
 *
 * test_config.c - configuration files: good ones are read, bad ones are refused with all their
 * errors; keys of the bus, of its recordings and expectations.
 *
 * It runs at the top of the source tree. Each file in tests/config/bad begins with its errors, one
 * a line: "# expect: LINE:COLUMN: a part of the message".
 */
#include "cases.h"
#include "configs.h"

#include <dirent.h>
#include <sys/wait.h>

#define BAD "tests/config/bad/"
#define EXPECT "# expect: "
#define PATH_SIZE 300

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

TEST(good_files_are_accepted)
{
    assert_in_range(each_file(GOOD, check_good), 5, 1000);
    assert_in_range(each_file("config/profiles/", check_good), 12, 1000);
    check_good("config/example.yaml");
}

/* Returns true for a line PATH:EXPECTED, where EXPECTED may stop in the middle of the message. It
 * may also name a file of its own. */
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
    FREED char *errors = errors_of(path);
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
        /* a list of what is allowed would hide the suggestion */
        if (strstr(line, "did you mean") && strcmp(line + strlen(line) - 3, "'?)") != 0)
            fail_msg("%s: the suggestion is not the last word", line);
    }
    if (rest && *rest)
        fail_msg("%s: not expected: %s", path, rest);
    fclose(file);
}

TEST(bad_files_are_refused_with_all_errors)
{
    assert_in_range(each_file(BAD, check_bad), 30, 1000);
}

TEST(defaults_are_set)
{
    CFG *config = load_good(GOOD "minimal.yaml");
    const cfg_node *node = &config->nodes[0];

    assert_string_equal(config->file, GOOD "minimal.yaml");
    assert_string_equal(config->bus_name, "can");
    assert_int_equal(cw_rate_ticks(config->rate, 1), 160);
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
}

TEST(lcm_urls_may_leave_the_address_to_liblcm)
{
    static const char *const urls[] = {"udpm://", "udpm://?ttl=1", "udpm://239.255.76.67?ttl=0",
                                       "mpudpm://", "tcpq://", "tcpq://my_host:7700"};
    for (unsigned i = 0; i < sizeof urls / sizeof *urls; i++) {
        char text[200];
        (void)snprintf(text, sizeof text,
                       "bus: { bitrate: 500000 }\nnodes: [{ name: a }]\nlcm: { url: \"%s\" }\n",
                       urls[i]);
        const cfg_file file = {.name = "lcm.yaml", .text = text, .size = strlen(text)};
        CFG *config = cfg_load_text(&file, stderr);
        assert_non_null(config);
        assert_string_equal(config->lcm.url, urls[i]);
    }
}

TEST(lcm_defaults_are_set)
{
    CFG *config = load_good(GOOD "quoted.yaml");

    assert_true(config->lcm.enabled);
    assert_string_equal(config->lcm.url, "udpm://239.255.76.67:7667?ttl=0");
    assert_int_equal(config->lcm.period.ns, 1000000000);
    assert_int_equal(config->lcm.events, 1u << CW_EVENT_ERROR | 1u << CW_EVENT_STATE |
                                             1u << CW_EVENT_RESTART | 1u << CW_EVENT_OVERLOAD |
                                             1u << CW_EVENT_DROP | 1u << CW_EVENT_FAULT);
}

TEST(bus_keys_are_read)
{
    CFG *config = load_good(GOOD "full.yaml");

    assert_string_equal(config->bus_name, "power_train.1");
    assert_int_equal(config->bitrate_bps, 125000);
    assert_int_equal(cw_rate_ticks(config->rate, 1), 640);
    assert_true(config->seed == UINT64_MAX);
    assert_string_equal(config->lcm.url, "memq://");
    assert_int_equal(config->lcm.period.ns, 250000000);
    assert_int_equal(config->lcm.events,
                     1u << CW_EVENT_TX | 1u << CW_EVENT_RX | 1u << CW_EVENT_ARBITRATION_LOST);
    assert_string_equal(config->control, GOOD "run/bus.sock");
    assert_int_equal(config->pacing, CFG_PACING_TICK);
    assert_int_equal(config->missing_port, CFG_MISSING_PORT_WAIT);
    assert_true(cfg_waits_for_port(config, &config->nodes[0]));
    assert_false(cfg_waits_for_port(config, &config->nodes[1]));
    assert_int_equal(config->catch_up.ns, 250000000);
}

TEST(recordings_are_read)
{
    static const cfg_record expected[] = {
        {.format = CFG_RECORD_CANDUMP, .size = 100000000, .files = 5},
        {.format = CFG_RECORD_PCAPNG, .size = 64000, .files = 1},
        {.format = CFG_RECORD_VCD, .size = UINT64_C(1000000000000), .files = 1000},
        {.format = CFG_RECORD_CANDUMP, .size = 100000, .files = 5},
    };
    CFG *config = load_good(GOOD "full.yaml");

    assert_int_equal(config->record_count, 4);
    assert_string_equal(config->records[0].file, GOOD "drive.log");
    assert_string_equal(config->records[1].file, "/tmp/drive.pcapng");
    for (size_t i = 0; i < 4; i++) {
        assert_int_equal(config->records[i].format, expected[i].format);
        assert_int_equal(config->records[i].size, expected[i].size);
        assert_int_equal(config->records[i].files, expected[i].files);
    }
}

TEST(expectations_are_read)
{
    CFG *config = load_good(GOOD "expect.yaml");
    const cfg_expect *e = config->expects;

    assert_int_equal(config->expect_count, 22);
    for (size_t i = 0; i < config->expect_count; i++)
        assert_int_equal(e[i].line, 11 + (int)i);
    assert_string_equal(config->expect_report, GOOD "reports/verdict.xml");
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
    assert_int_equal(e[17].when.rate, CW_RATE_ANY);
    assert_int_equal(e[18].kind, CFG_EXPECT_EXCEPTIONS);
    assert_int_equal(e[18].max, 2);
    assert_int_equal(e[19].when.rate, CW_RATE_DATA);
    assert_int_equal(e[20].when.rate, CW_RATE_NOMINAL);
}

/* The texts of all files are kept, and the configuration can be made of them alone. */
TEST(files_are_kept_and_can_be_given)
{
    CFG *config = load_good(GOOD "profiles.yaml");
    cfg_file renamed[8];
    FREED char *errors = NULL;
    size_t length = 0;

    assert_in_range(config->file_count, 2, COUNT(renamed));
    assert_string_equal(config->files[0].name, GOOD "profiles.yaml");
    for (size_t i = 0; i < config->file_count; i++)
        renamed[i] = (cfg_file){.name = config->files[i].name,
                                .text = config->files[i].text,
                                .size = config->files[i].size};
    assert_non_null(strstr(renamed[0].text, "profiles:"));
    CFG *again = cfg_load_given(renamed, config->file_count, stderr);
    assert_non_null(again);
    assert_int_equal(again->rule_count, config->rule_count);
    assert_int_equal(again->file_count, config->file_count);
    FILE *out = open_memstream(&errors, &length);
    assert_null(cfg_load_given(renamed, 1, out)); /* though the others are there */
    fclose(out);
    assert_non_null(strstr(errors, "this file is not among those that are given"));
}

TEST(bus_config_is_usable)
{
    static const char *const files[] = {GOOD "full.yaml", GOOD "minimal.yaml"};

    for (size_t i = 0; i < COUNT(files); i++) {
        CFG *config = load_good(files[i]);
        cw_node_config nodes[CW_NODES_MAX];
        cw_bus_config bus;

        cfg_bus_config(&bus, nodes, config);
        assert_int_equal(bus.bit_ticks, cw_rate_ticks(config->rate, 1));
        assert_int_equal(bus.node_count, config->node_count);
        assert_int_equal(bus.rule_count, config->rule_count);
        assert_int_equal(nodes[0].restart_ticks, config->nodes[0].restart_ms * UINT64_C(80000));
        assert_int_equal(nodes[0].queue, config->nodes[0].queue);
        assert_true(cw_bus_size(&bus) > 0);
    }
}

/* Returns exit status and standard output of canwire, which the environment names. */
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

TEST(check_prints_a_summary_or_the_ports)
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
    if (!getenv("CANWIRE"))
        skip();
    for (size_t i = 0; i < COUNT(cases); i++) {
        char output[LINE_SIZE];

        assert_int_equal(run_tool(output, sizeof output, cases[i].arguments), cases[i].status);
        assert_string_equal(output, cases[i].output);
    }
}
