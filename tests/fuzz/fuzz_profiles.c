/* SPDX-License-Identifier: MIT
 *
 * fuzz_profiles.c - configurations with the profiles that they load with `with:`; and the bus that
 * comes of them.
 *
 * Input: the configuration, then behind lines "=== NAME" the files that it may name.
 */
#include "fuzz.h"

#include "config/config.h"
#include "parts.h"
#include "simulate.h"

#include <stdlib.h>
#include <string.h>

/* Returns the messages, to be freed, and the configuration. */
static char *load(cfg **config, const cfg_file *files, size_t count)
{
    char *messages = NULL;
    size_t length = 0;
    FILE *errors = open_memstream(&messages, &length);
    REQUIRE(errors != NULL);
    *config = cfg_load_given(files, count, errors);
    REQUIRE(fclose(errors) == 0);
    REQUIRE((length == 0) == (*config != NULL));
    return messages;
}

/* Checks that each message is a line that begins with the name of a file. */
static void check_messages(const char *messages, const cfg_file *files, size_t count)
{
    for (const char *line = messages; *line; line = strchr(line, '\n') + 1) {
        bool named = strchr(line, '\n') != NULL;
        bool known = false;
        for (size_t i = 0; i < count; i++)
            known = known || strncmp(line, files[i].name, strlen(files[i].name)) == 0;
        /* a file that is not given is named as it is asked for */
        known = known || strstr(line, ": this file is not among those that are given\n");
        REQUIRE(named && known);
    }
}

static void check_warnings(const cfg *config)
{
    for (const char *line = config->warnings; *line; line = strchr(line, '\n') + 1) {
        const char *end = strchr(line, '\n');
        const char *word = strstr(line, ": warning: ");
        REQUIRE(end && word && word < end);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    fuzz_part parts[FUZZ_PARTS_MAX];
    cfg_file files[FUZZ_PARTS_MAX];
    cfg *config;
    cfg *again;
    size_t count = fuzz_split(parts, data, size);
    for (size_t i = 0; i < count; i++)
        files[i] = (cfg_file){.name = i == 0 ? "bus.yaml" : parts[i].head,
                              .text = parts[i].text, .size = parts[i].size};
    char *messages = load(&config, files, count);
    check_messages(messages, files, count);
    /* the files that the configuration keeps give the same configuration */
    const cfg_file *kept = config ? config->files : files;
    char *repeated = load(&again, kept, config ? config->file_count : count);
    REQUIRE(strcmp(messages, repeated) == 0);
    if (config) {
        REQUIRE(again && strcmp(again->warnings, config->warnings) == 0);
        check_warnings(config);
        fuzz_simulate(config);
    }
    cfg_free(config);
    cfg_free(again);
    free(messages);
    free(repeated);
    return 0;
}
