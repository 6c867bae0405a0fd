/* SPDX-License-Identifier: MIT
 *
 * files.c - the files that a bus reads and writes, under the names in its configuration.
 */
#include "config/files.h"

#include "config/node/portname.h"

static fileuse at_place(const cfg *config, cfg_place place)
{
    return (fileuse){.file = config->file, .line = place.line, .column = place.column};
}

/* Adds the files that replays of a node read. */
static void add_replays(fileuses *all, const cfg *config, const cfg_node *node)
{
    for (size_t i = 0; i < node->traffic_count; i++) {
        const cfg_traffic *traffic = &node->traffic[i];
        fileuse use = at_place(config, traffic->place);
        use.what = "replay";
        use.path = traffic->file;
        if (traffic->kind == CFG_TRAFFIC_REPLAY)
            fileuses_add(all, &use);
    }
}

void cfg_add_files_read(fileuses *all, const cfg *config)
{
    for (size_t i = 0; i < config->file_count; i++)
        fileuses_add(all, &(fileuse){.what = i == 0 ? "the configuration" : "the profile",
                                     .path = config->files[i].name});
    for (size_t i = 0; i < config->node_count; i++)
        add_replays(all, config, &config->nodes[i]);
}

void cfg_add_files_written(fileuses *all, const cfg *config)
{
    for (size_t i = 0; i < config->record_count; i++) {
        fileuse use = at_place(config, config->records[i].place);
        use.what = "record";
        use.path = config->records[i].file;
        use.written = true;
        use.older = config->records[i].files - 1;
        fileuses_add(all, &use);
    }
    fileuse report = at_place(config, config->expect_report_place);
    report.what = "expect-report";
    report.path = config->expect_report;
    report.written = true;
    if (report.path)
        fileuses_add(all, &report);
}

void cfg_add_sockets(fileuses *all, const cfg *config)
{
    fileuse use = at_place(config, config->control_place);
    use.what = "control";
    use.path = config->control;
    if (use.path)
        fileuses_add_socket(all, &use);
    use = at_place(config, config->metrics.place);
    use.what = "metrics";
    use.path = config->metrics.path;
    if (use.path)
        fileuses_add_socket(all, &use);
    use = at_place(config, config->virtual_time.place);
    use.what = "virtual";
    use.path = config->virtual_time.socket;
    if (use.path)
        fileuses_add_socket(all, &use);
    for (size_t i = 0; i < config->node_count; i++) {
        const cfg_node *node = &config->nodes[i];
        const portname port = portname_parse(node->port ? node->port : "");
        use = at_place(config, node->port_place);
        use.what = "port";
        use.path = port.path;
        if (port.path && node->guest <= 1) /* guests share one */
            fileuses_add_socket(all, &use);
    }
}

static void add_all(fileuses *all, const fileuses *others)
{
    for (size_t i = 0; others && i < others->count; i++)
        fileuses_add(all, &others->uses[i]);
    all->incomplete = all->incomplete || (others && others->incomplete);
}

bool cfg_check_files(const cfg *config, const fileuses *others, const char *program, FILE *errors)
{
    return cfg_check_all_files(&config, 1, others, program, errors);
}

bool cfg_check_all_files(const cfg *const *configs, size_t count, const fileuses *others,
                         const char *program, FILE *errors)
{
    fileuses all = {.count = 0};
    for (size_t i = 0; i < count; i++) {
        cfg_add_files_read(&all, configs[i]);
        cfg_add_sockets(&all, configs[i]);
    }
    add_all(&all, others);
    for (size_t i = 0; i < count; i++)
        cfg_add_files_written(&all, configs[i]);
    bool good = fileuses_check(&all, program, errors);
    fileuses_free(&all);
    return good;
}
