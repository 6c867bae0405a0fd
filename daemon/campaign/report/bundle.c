/* SPDX-License-Identifier: MIT
 *
 * bundle.c - the documents of a scenario, from which items can be left out: a bus, or a rig and
 * its buses.
 */
#include "campaign/report/bundle.h"

#include "campaign/report/memory.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>

/* ---- Loading --------------------------------------------------------------------------------- */

/* Loads a rig, in silence, to learn the names and files of its buses. */
static rig *load_rig(const bundle *b, const char *text, size_t size)
{
    const cfg_file file = {.name = b->file, .text = text, .size = size};
    FILE *nowhere = fopen("/dev/null", "re");
    rig *r = nowhere ? rig_load_text(&file, nowhere) : NULL;
    if (nowhere)
        (void)fclose(nowhere);
    return r;
}

/* The prefix keeps a bus with the name `rig` off the file of the rig. */
static bool load_bus(bundle *b, const cfg *config, size_t item)
{
    bundle_bus *bus = &b->buses[b->bus_count++];
    const yaml_node_t *written = yaml_document_get_node(&b->main.document, (int)item);
    bus->item = item;
    bus->written = memory_text((const char *)written->data.scalar.value);
    bus->file = memory_text(config->files[0].name);
    bus->moved = memory_print("bus-%s.yaml", config->bus_name);
    b->main.renamed[item] = bus->moved;
    return outline_load(&bus->outline, config->files[0].text, config->files[0].size) &&
           !bus->outline.is_rig;
}

/* The files of the buses have been read with the rig. */
static bool load_buses(bundle *b, const char *text, size_t size)
{
    rig *r = load_rig(b, text, size);
    const outline_list *list = outline_buses(&b->main);
    bool good = r != NULL;
    for (size_t i = 0; good && i < r->bus_count; i++)
        good = load_bus(b, r->buses[i], outline_item(list, i));
    rig_free(r);
    return good;
}

bool bundle_load(bundle *b, const char *file, const char *text, size_t size)
{
    *b = (bundle){.file = memory_text(file)};
    return outline_load(&b->main, text, size) &&
           (!b->main.is_rig || load_buses(b, text, size));
}

static void free_bus(bundle_bus *bus)
{
    free(bus->written);
    free(bus->file);
    free(bus->moved);
    outline_free(&bus->outline);
}

void bundle_free(bundle *b)
{
    for (size_t i = 0; i < b->bus_count; i++)
        free_bus(&b->buses[i]);
    outline_free(&b->main);
    free(b->file);
    *b = (bundle){.file = NULL};
}

/* ---- Documents ------------------------------------------------------------------------------- */

static bool is_kept(const bundle *b, size_t bus)
{
    return !b->main.left_out[b->buses[bus].item];
}

outline *bundle_document(bundle *b, size_t i, bool *gone)
{
    *gone = i > 0 && i <= b->bus_count && !is_kept(b, i - 1);
    if (*gone || i > b->bus_count)
        return NULL;
    return i == 0 ? &b->main : &b->buses[i - 1].outline;
}

size_t bundle_count(const bundle *b, outline_kind kind)
{
    size_t count = outline_count(&b->main, kind);
    for (size_t i = 0; i < b->bus_count; i++)
        if (is_kept(b, i))
            count += outline_count(&b->buses[i].outline, kind);
    return count;
}

bool bundle_is_single(const bundle *b)
{
    return b->main.is_rig && outline_count(&b->main, OUTLINE_BUSES) == 1 &&
           outline_count(&b->main, OUTLINE_GATEWAYS) == 0;
}

/* Returns the one bus that is left. bundle_is_single() must have returned true. */
static bundle_bus *kept_bus(bundle *several)
{
    size_t kept = 0;
    while (!is_kept(several, kept))
        kept++;
    return &several->buses[kept];
}

void bundle_promote(bundle *single, bundle *several)
{
    bundle_bus *bus = kept_bus(several);
    *single = (bundle){.file = memory_text(bus->file), .main = bus->outline};
    bus->outline = (outline){.loaded = false};
}

void bundle_demote(bundle *single, bundle *several)
{
    kept_bus(several)->outline = single->main;
    single->main = (outline){.loaded = false};
    bundle_free(single);
}

/* ---- Texts ----------------------------------------------------------------------------------- */

/* Returns the folder of a file, to be freed. */
static char *folder_of(const char *file)
{
    char real[PATH_MAX];
    if (!realpath(file, real))
        return memory_text(".");
    *strrchr(real, '/') = '\0';
    return memory_text(real);
}

/* Names of files in the text stay what they mean where the text is written to. */
static char *bundle_text_of(const outline *o, const char *file, bool without_faults, bool moved)
{
    char *folder = moved ? folder_of(file) : NULL;
    char *text = outline_text(o, without_faults, folder);
    free(folder);
    return text;
}

bool bundle_write(bundle_text *out, const bundle *b, bool without_faults, bool moved)
{
    *out = (bundle_text){.main = bundle_text_of(&b->main, b->file, without_faults, moved)};
    bool good = out->main != NULL;
    for (size_t i = 0; i < b->bus_count && good; i++) {
        const bundle_bus *bus = &b->buses[i];
        if (!is_kept(b, i))
            continue;
        char *text = bundle_text_of(&bus->outline, bus->file, without_faults, moved);
        good = text != NULL;
        out->buses[out->count++] =
            (cfg_file){.name = memory_text(moved ? bus->moved : bus->written), .text = text,
                       .size = text ? strlen(text) : 0};
    }
    return good;
}

bool bundle_text_equals(const bundle_text *a, const bundle_text *b)
{
    bool same = a->count == b->count && strcmp(a->main, b->main) == 0;
    for (size_t i = 0; i < a->count && same; i++)
        same = strcmp(a->buses[i].name, b->buses[i].name) == 0 &&
               strcmp(a->buses[i].text, b->buses[i].text) == 0;
    return same;
}

void bundle_text_free(bundle_text *t)
{
    free(t->main);
    for (size_t i = 0; i < t->count; i++) {
        free((char *)t->buses[i].name);
        free((char *)t->buses[i].text);
    }
    *t = (bundle_text){.main = NULL};
}
