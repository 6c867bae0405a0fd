/* SPDX-License-Identifier: MIT
 *
 * vhci.c - the ports of the kernel's virtual USB host controllers (module vhci-hcd), by sysfs.
 */
#include "usb/vhci.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define FOLDER "/sys/devices/platform/vhci_hcd.0/"
#define STATE "/sys/module/vhci_hcd/initstate" /* missing where it is not a module */
#define CONTROLLERS_MAX 128u /* as many as the kernel can have */
#define PATH_BYTES 80u
#define LINE_BYTES 160u
#define HIGH_SPEED 3

/* States of a port, of the file `status`. */
#define PORT_FREE 4
#define PORT_USED 6

typedef struct port_line {
    int port;
    int state;
    char hub[8];
    char bus_id[VHCI_BUS_ID_MAX];
} port_line;

/* Returns false while the module is being loaded or removed. Linux 6.1 has the file `status` before
 * the second hub that it shows, and whoever reads it then ends in an oops. */
static bool is_settled(void)
{
    char line[LINE_BYTES] = "";
    FILE *state = fopen(STATE, "re");
    if (!state)
        return errno == ENOENT;
    const bool good = fgets(line, sizeof line, state) && strcmp(line, "live\n") == 0;
    (void)fclose(state);
    return good;
}

bool vhci_open(vhci *v)
{
    if (!is_settled()) {
        errno = ENOENT;
        return false;
    }
    v->attach = open(FOLDER "attach", O_WRONLY | O_NOFOLLOW | O_CLOEXEC);
    v->detach = open(FOLDER "detach", O_WRONLY | O_NOFOLLOW | O_CLOEXEC);
    const int number = errno;
    if (v->attach >= 0 && v->detach >= 0)
        return true;
    if (v->attach >= 0)
        (void)close(v->attach);
    errno = number;
    return false;
}

bool vhci_is_there(const vhci *v)
{
    struct stat own, now;
    return fstat(v->attach, &own) == 0 && stat(FOLDER "attach", &now) == 0 &&
           own.st_ino == now.st_ino;
}

/* Reads "hs  0000 004 000 00000000 000000 0-0"; the first line has words. */
static bool vhci_read_line(port_line *out, const char *line)
{
    return sscanf(line, "%7s %d %d %*s %*s %*s %31s", out->hub, &out->port, &out->state,
                  out->bus_id) == 4;
}

static FILE *open_status(unsigned controller)
{
    char path[PATH_BYTES];
    if (!is_settled())
        return NULL;
    if (controller == 0)
        (void)snprintf(path, sizeof path, FOLDER "status");
    else
        (void)snprintf(path, sizeof path, FOLDER "status.%u", controller);
    return fopen(path, "re");
}

/* Finds a line of one controller that fits. */
static bool look_in(FILE *status, port_line *out, bool (*fits)(const port_line *, const void *),
                    const void *arg)
{
    char line[LINE_BYTES];
    while (fgets(line, sizeof line, status))
        if (vhci_read_line(out, line) && fits(out, arg))
            return true;
    return false;
}

/* Finds the first port that fits. */
static bool vhci_find(port_line *out, bool (*fits)(const port_line *, const void *),
                      const void *arg)
{
    for (unsigned i = 0; i < CONTROLLERS_MAX; i++) {
        FILE *status = open_status(i);
        if (!status)
            return false;
        const bool found = look_in(status, out, fits, arg);
        (void)fclose(status);
        if (found)
            return true;
    }
    return false;
}

typedef struct port_set {
    const int *ports;
    size_t count;
} port_set;

/* Returns true for a high-speed port that is free and not among the used ones. */
static bool is_free(const port_line *line, const void *arg)
{
    const port_set *used = arg;
    for (size_t i = 0; i < used->count; i++)
        if (used->ports[i] == line->port)
            return false;
    return line->state == PORT_FREE && strcmp(line->hub, "hs") == 0;
}

int vhci_find_port(const int *used, size_t count)
{
    port_line line;
    const port_set set = {.ports = used, .count = count};
    if (vhci_find(&line, is_free, &set))
        return line.port;
    errno = EBUSY;
    return -1;
}

static bool is_ready(const port_line *line, const void *arg)
{
    return line->port == *(const int *)arg && line->state == PORT_USED;
}

bool vhci_bus_id(char out[VHCI_BUS_ID_MAX], int port)
{
    port_line line;
    if (!vhci_find(&line, is_ready, &port))
        return false;
    memcpy(out, line.bus_id, VHCI_BUS_ID_MAX);
    return true;
}

static bool vhci_write_text(int fd, const char *text)
{
    const size_t length = strlen(text);
    return pwrite(fd, text, length, 0) == (ssize_t)length;
}

/* The device number is of no use here; the port is one. */
bool vhci_attach(const vhci *v, int port, int socket)
{
    char text[LINE_BYTES];
    (void)snprintf(text, sizeof text, "%d %d %d %d", port, socket, port + 1, HIGH_SPEED);
    return vhci_write_text(v->attach, text);
}

void vhci_detach(const vhci *v, int port)
{
    char text[LINE_BYTES];
    (void)snprintf(text, sizeof text, "%d", port);
    (void)vhci_write_text(v->detach, text);
}
