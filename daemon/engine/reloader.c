/* SPDX-License-Identifier: MIT
 *
 * reloader.c - reads the configuration again beside the bus, on request.
 */
#include "engine/reloader.h"

#include "base/file/aside.h"
#include "base/text/memo.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#define BUSY_S 0.1 /* a thread that has used so much processor time does not hang */
#define WHY_MAX 140

/* Limit of rounds that were given up while their threads still hang; then no other round begins. */
#define LEFT_MAX 4u

/* The task of a thread. */
typedef struct reading {
    char *file;
    fileuses others;
    char *rig; /* the file of a rig and its text, or NULL */
    char *rig_text;
    size_t rig_size;
    memo errors;
    reload *result; /* NULL: there are errors */
} reading;

struct reloader {
    struct ev_loop *loop;
    const fileuses *others;
    const rig *rig; /* or NULL */
    const reloader_calls *calls;
    void *user;
    aside *aside;   /* NULL: nothing is being read */
    char *file;     /* that is being read */
    char *next;     /* to be read next; NULL: none */
    uint64_t round; /* being read, or the last one */
};

/* ---- In the thread --------------------------------------------------------------------------- */

static void read_config(void *task)
{
    reading *t = task;
    if (!t->rig || rig_is_same(t->rig, t->rig_text, t->rig_size, t->errors.out))
        t->result = reload_read(t->file, &t->others, t->errors.out);
}

/* Frees what was read aside, with its result if nobody has taken it. */
static void free_reading(void *task)
{
    reading *t = task;
    reload_free(t->result);
    memo_end(&t->errors);
    fileuses_free(&t->others);
    free(t->file);
    free(t->rig);
    free(t->rig_text);
    free(t);
}

/* Makes the task. All of it belongs to the thread, which may outlive everything else. */
static reading *make_reading(const char *file, const fileuses *others, const rig *of)
{
    reading *t = calloc(1, sizeof *t);
    if (!t)
        return NULL;
    for (size_t i = 0; i < others->count; i++)
        fileuses_add(&t->others, &others->uses[i]);
    t->others.incomplete = t->others.incomplete || others->incomplete;
    t->file = strdup(file);
    (void)memo_begin(&t->errors);
    if (of) {
        t->rig = strdup(of->file);
        t->rig_text = malloc(of->size + 1);
        t->rig_size = of->size;
    }
    if (t->rig_text)
        memcpy(t->rig_text, of->text, of->size);
    if (t->file && t->errors.out && (!of || (t->rig && t->rig_text)))
        return t;
    free_reading(t);
    return NULL;
}

/* ---- Rounds ---------------------------------------------------------------------------------- */

static void reloader_go_on(reloader *r);

/* A configuration has been read aside. The bus takes it, or says why not. */
static void on_done(void *user, void *task)
{
    reloader *r = user;
    reading *t = task;
    bool good = false;
    r->aside = NULL;
    if (t->result)
        good = r->calls->take(r->user, t->result, t->errors.out);
    t->result = NULL;
    char none[] = "out of memory\n";
    char *text = memo_text(&t->errors);
    r->calls->over(r->user, r->round, good ? NULL : text && *text ? text : none);
    free_reading(t);
    reloader_go_on(r);
}

/* Reading takes too long and is given up, so that other requests need not wait. */
static void on_late(void *user, double busy_s)
{
    reloader *r = user;
    char *text = NULL;
    char none[] = "out of memory\n";
    char why[WHY_MAX] = "; does a disk or a network hang?";
    r->aside = NULL;
    if (busy_s >= BUSY_S)
        (void)snprintf(why, sizeof why,
                       ", after %.1f s of work: are the files large, are large profiles loaded "
                       "often, or is the machine busy?",
                       busy_s);
    if (asprintf(&text,
                 "%s: reading it, and the files that it names, takes longer than %d s and is given "
                 "up%s\n",
                 r->file, RELOADER_LIMIT_S, why) < 0)
        text = NULL;
    r->calls->over(r->user, r->round, text ? text : none);
    free(text);
    reloader_go_on(r);
}

static const aside_calls reading_calls = {
    .work = read_config, .drop = free_reading, .done = on_done, .late = on_late};

/* Begins the next round and takes over the name. Returns false after writing the reason. */
static bool reloader_begin(reloader *r, char *file, FILE *errors)
{
    free(r->file);
    r->file = file;
    r->round++;
    if (aside_left() >= LEFT_MAX) {
        fprintf(errors,
                "%s: %u reloads were given up and still hang; before one of them comes back there "
                "is no other\n",
                file, aside_left());
        return false;
    }
    reading *t = make_reading(file, r->others, r->rig);
    errno = ENOMEM;
    if (t)
        r->aside = aside_start(r->loop, &reading_calls, t, r, RELOADER_LIMIT_S);
    if (r->aside) {
        r->calls->begins(r->user);
        return true;
    }
    fprintf(errors, "%s: it cannot be read: %s\n", file, strerror(errno));
    if (t)
        free_reading(t);
    return false;
}

/* Begins the round that has been requested meanwhile. */
static void reloader_go_on(reloader *r)
{
    memo errors;
    char *file = r->next;
    r->next = NULL;
    if (!file)
        return;
    bool good = memo_begin(&errors) && reloader_begin(r, file, errors.out);
    if (!errors.out) {
        r->round++;
        free(file);
    }
    char none[] = "out of memory\n";
    if (!good)
        r->calls->over(r->user, r->round, memo_text(&errors) ? errors.text : none);
    memo_end(&errors);
}

/* ---- Public functions ------------------------------------------------------------------------ */

reloader *reloader_new(struct ev_loop *loop, const fileuses *others, const reloader_calls *calls,
                       void *user)
{
    reloader *r = calloc(1, sizeof *r);
    if (r)
        *r = (reloader){.loop = loop, .others = others, .calls = calls, .user = user};
    return r;
}

void reloader_keep_rig(reloader *r, const rig *config)
{
    r->rig = config;
}

uint64_t reloader_ask(reloader *r, const char *file, FILE *errors)
{
    char *copy = strdup(file);
    if (!copy) {
        fputs("out of memory\n", errors);
        return 0;
    }
    if (!reloader_is_busy(r))
        return reloader_begin(r, copy, errors) ? r->round : 0;
    free(r->next);
    r->next = copy;
    return r->round + 1;
}

bool reloader_is_busy(const reloader *r)
{
    return r->aside || r->next;
}

static void stop_round(reloader *r, uint64_t round)
{
    char text[] = "canwired is stopping\n";
    r->calls->over(r->user, round, text);
}

void reloader_free(reloader *r)
{
    if (!r)
        return;
    if (r->aside)
        stop_round(r, r->round);
    if (r->next)
        stop_round(r, r->round + 1);
    aside_leave(r->aside);
    free(r->file);
    free(r->next);
    free(r);
}
