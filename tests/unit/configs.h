/* SPDX-License-Identifier: MIT
 *
 * configs.h - configuration files for unit tests: loaded, and what was said about them.
 */
#ifndef CANWIRE_TEST_CONFIGS_H
#define CANWIRE_TEST_CONFIGS_H

#include "cases.h"
#include "config/config.h"

#include <unistd.h>

#define GOOD "tests/config/good/"
#define LINE_SIZE 2000
#define TICKS_PER_S UINT64_C(80000000)

/* Returns the messages of a load, to be freed; NULL when it was good. */
static inline char *errors_of(const char *file)
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

/* CFG *config = ...; is freed where the block ends. */
#define CFG __attribute__((cleanup(cfg_end))) cfg
static inline void cfg_end(cfg **config)
{
    cfg_free(*config);
}

static inline cfg *load_good(const char *file)
{
    cfg *config = cfg_load(file, stderr);

    assert_non_null(config);
    return config;
}

/* Returns the rule of that name. */
static inline const cw_rule *rule_of(const cfg *config, const char *name)
{
    for (size_t i = 0; i < config->rule_count; i++)
        if (strcmp(config->rules[i].name, name) == 0)
            return &config->rules[i];
    fail_msg("no rule %s", name);
    return NULL;
}

/* Makes a file with this content; drop_file() removes and frees it. */
static inline char *make_file(const void *content, size_t length)
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

static inline void drop_file(char *path)
{
    unlink(path);
    free(path);
}

#endif
