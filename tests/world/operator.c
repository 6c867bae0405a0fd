/* SPDX-License-Identifier: MIT
 *
 * operator.c - edits the configuration, and causes trouble of the machine: its disk, its clock, its
 * power.
 */
#include "world.h"

#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static actor edits, disasters;
static unsigned version;

/* ---- The configuration ----------------------------------------------------------------------- */

static void write_bad_config(void)
{
    FILE *out = fopen("bus.yaml.new", "w");
    fputs("bus: { name: w, bitrate: 7 }\nnodes: [ { nam: e0 } ]\n", out);
    (void)fclose(out);
    (void)rename("bus.yaml.new", "bus.yaml");
    world->config_is_bad = true;
}

static void hang_up_signal(void)
{
    if (manager_is_up())
        life_signal(life_now(), SIGHUP);
}

static void edit(actor *self)
{
    self->next_ns = world->now_ns + 50 * MS + (int64_t)world_draw(600 * MS);
    if (!manager_is_up())
        return;
    if (world_chance(200) && the_story.reloads)
        write_bad_config();
    else
        story_write_config(++version);
    if (world_chance(700) || !the_story.reloads)
        hang_up_signal(); /* else the client that asks reloads */
    if (the_story.flood)
        self->next_ns = NEVER;
}

/* ---- What befalls the machine ---------------------------------------------------------------- */

static void put_fifo(void)
{
    (void)unlink("bus.yaml");
    (void)mkfifo("bus.yaml", 0600);
    world->config_is_bad = true;
    world_trace("bus.yaml is a FIFO now");
    hang_up_signal();
}

static void hang_file(void)
{
    (void)snprintf(world->disk.hung_path, sizeof world->disk.hung_path, "bus.yaml");
    world->disk.hung_until_ns = world->now_ns + 100 * S;
    world_trace("the mount that has bus.yaml hangs");
    hang_up_signal();
}

static void break_disk(void)
{
    world_disk *d = &world->disk;
    if (the_story.full_disk)
        d->room = (int64_t)world_draw(3000);
    if (the_story.bad_disk)
        d->errors_permille = 1 + (unsigned)world_draw(300);
    if (the_story.slow_disk)
        d->slow_ns = world_between(1 * MS, 300 * MS);
    if (the_story.hung_disk) {
        d->hung_path[0] = '\0';
        d->hung_until_ns = world->now_ns + (int64_t)world_draw(3 * S);
    }
    d->short_permille = (unsigned)world_draw(200);
    world_trace("the disk is full, bad, slow or hangs");
}

static void stand_still(void)
{
    int life = life_now();
    if (life < 0)
        return;
    int64_t ns = world_between(1 * MS, 3 * S);
    if (world_chance(500)) {
        world->boottime_ns += ns;
        world_trace("suspended for %lld us", (long long)(ns / US));
    } else {
        world->lives[life].stopped_until_ns = world->now_ns + ns;
        world_trace("SIGSTOP for %lld us", (long long)(ns / US));
    }
}

static void step_clock(void)
{
    int64_t ns = world_between(1 * MS, 1000 * S);
    world->realtime_ns += world_chance(500) ? ns : -ns;
    world_trace("the clock is set, %lld us", (long long)(ns / US));
}

static void befall(actor *self)
{
    const story *s = &the_story;
    self->next_ns = world->now_ns + 100 * MS + (int64_t)world_draw(1500 * MS);
    if (!manager_is_up())
        return;
    if (s->stops && world_chance(400))
        stand_still();
    if (s->clock_steps && world_chance(400))
        step_clock();
    if (s->fifo)
        put_fifo();
    if (s->hung_file)
        hang_file();
    if (s->full_disk || s->bad_disk || s->slow_disk || s->hung_disk)
        break_disk();
    if (s->power)
        life_power_loss();
}

static void mend(void)
{
    world->disk = (world_disk){.room = NEVER};
    world->refuse_permille = 0;
    if (world->config_is_bad) {
        (void)unlink("bus.yaml");
        story_write_config(version);
    }
    world_trace("all is well again");
}

void operator_quiet(void)
{
    edits.next_ns = NEVER;
    disasters.next_ns = NEVER;
    mend();
}

void operator_add(void)
{
    const story *s = &the_story;
    version = 0;
    story_write_config(0);
    edits =
        (actor){.next_ns = world->now_ns + 300 * MS + (int64_t)world_draw(500 * MS), .act = edit};
    disasters =
        (actor){.next_ns = world->now_ns + 200 * MS + (int64_t)world_draw(800 * MS), .act = befall};
    if (s->reloads || s->flood)
        world_add_actor(&edits);
    world_add_actor(&disasters);
}
