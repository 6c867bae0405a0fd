/* SPDX-License-Identifier: MIT
 *
 * test_config.c - configuration files: what is read from good ones, what is said about bad ones.
 *
 * Runs at the top of the source tree. Each file in tests/config/bad begins with its errors, one a
 * line: "# expect: LINE:COLUMN: a part of the message".
 */
#include "config.h"
#include "yamlfile.h"

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
    assert_int_equal(engine->restart_ms, 100);
    assert_true(engine->berr_reporting);
    assert_int_equal(engine->modes, CW_MODE_ONE_SHOT | CW_MODE_LISTEN_ONLY | CW_MODE_LOOPBACK |
                                        CW_MODE_PRESUME_ACK | CW_MODE_BERR_REPORTING);
    assert_int_equal(engine->queue, 4096);
    assert_int_equal(engine->order, CW_ORDER_FIFO);
    assert_int_equal(engine->warning_limit, 255);
    assert_int_equal(gearbox->modes, 0);
    assert_false(gearbox->berr_reporting);
    assert_int_equal(gearbox->warning_limit, 1);
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
                        "tests/config/none.yaml: cannot open: No such file or directory\n");
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
         "config/example.yaml: ok (bus powertrain, 500000 bit/s, 3 nodes, 0 rules)\n"},
        {"check " GOOD "minimal.yaml", 0,
         GOOD "minimal.yaml: ok (bus can, 500000 bit/s, 1 node, 0 rules)\n"},
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
        cmocka_unit_test(bus_keys_are_read),
        cmocka_unit_test(node_keys_are_read),
        cmocka_unit_test(traffic_is_read),
        cmocka_unit_test(rules_are_read),
        cmocka_unit_test(rule_defaults_act_always),
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
