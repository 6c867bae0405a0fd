/* SPDX-License-Identifier: MIT
 *
 * fuzz_rules.c - fault rules from a text, as they are injected into a running bus; and what they
 * do.
 */
#include "fuzz.h"

#include "config/config.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#define RULES_MAX 64u /* more take too long */
#define BITS 20000u

static const char configuration[] =
    "bus: { bitrate: 500000 }\n"
    "seed: 7\n"
    "nodes:\n"
    "  - { name: engine, queue: 4 }\n"
    "  - { name: gearbox, restart-ms: 1 }\n"
    "  - { name: brakes, order: fifo }\n"
    "  - { name: door, one-shot: yes }\n"
    "faults:\n"
    "  - { name: first, when: { frame: \"123\", from: engine }, do: { flip: \"crc[3]\" } }\n"
    "  - { name: second, when: { after: { rule: first } }, do: { overload: door } }\n";

static cfg *load_configuration(void)
{
    char path[32];
    int fd = memfd_create("bus.yaml", MFD_CLOEXEC);
    size_t length = strlen(configuration);
    REQUIRE(fd >= 0 && write(fd, configuration, length) == (ssize_t)length);
    (void)snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    cfg *config = cfg_load(path, stderr);
    REQUIRE(config != NULL);
    (void)close(fd);
    return config;
}

static void open_bus(fuzz_bus *b, const cfg *config)
{
    cw_node_config nodes[CW_NODES_MAX];
    cw_bus_config bus_config;
    cfg_bus_config(&bus_config, nodes, config);
    bus_config.rule_room = RULES_MAX;
    REQUIRE(fuzz_bus_open(b, &bus_config));
}

/* The bus must accept all rules that the loader accepts. */
static void add_rules(fuzz_bus *b, const cfg_rules *rules, size_t base)
{
    unsigned index[RULES_MAX];
    for (size_t i = 0; i < rules->count; i++) {
        cw_rule rule = rules->rules[i];
        REQUIRE(!rule.has_after || rule.after < base + i);
        if (rule.has_after && rule.after >= base)
            rule.after = (uint16_t)index[rule.after - base];
        REQUIRE(cw_bus_add_rule(b->bus, &index[i], &rule) == CW_OK);
        if (rule.manual)
            REQUIRE(cw_bus_fire_rule(b->bus, index[i]) == CW_OK);
    }
}

static void run_rules(const cfg *config, const cfg_rules *rules, uint64_t seed)
{
    fuzz_bus b;
    open_bus(&b, config);
    fuzz_bus_traffic(&b, BITS / 10, seed);
    add_rules(&b, rules, config->rule_count);
    fuzz_bus_traffic(&b, BITS, seed);
    fuzz_bus_close(&b);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static cfg *config;
    char *messages = NULL;
    size_t length = 0;
    if (!config)
        config = load_configuration();
    char *text = fuzz_text(data, size); /* so that reading behind its end is seen */
    FILE *errors = open_memstream(&messages, &length);
    cfg_rules *rules = cfg_load_rules(text, size, "input", config, NULL, errors);
    (void)fclose(errors);
    REQUIRE((length == 0) == (rules != NULL));
    if (getenv("FUZZ_TRACE"))
        fputs(messages, stderr);
    if (rules && rules->count <= RULES_MAX)
        run_rules(config, rules, fuzz_hash(data, size));
    cfg_free_rules(rules);
    free(messages);
    free(text);
    return 0;
}
