/* SPDX-License-Identifier: MIT
 *
 * portname.c - the meaning of the name of a port: an interface, or a socket in place of one.
 */
#include "config/node/portname.h"

#include "base/text/number.h"
#include "base/text/plain.h"
#include "config/node/tunnelname.h"

#include <ctype.h>
#include <stdio.h>
#include <string.h>

#define INTERFACE_NAME_MAX 15u /* IFNAMSIZ with its final 0 has 16 bytes */
#define FD_MAX 999999u
#define NAME_CHARS                                                                                 \
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_."

static const char *behind(const char *text, const char *prefix)
{
    size_t length = strlen(prefix);
    return strncmp(text, prefix, length) == 0 ? text + length : NULL;
}

/* Returns true for a name that the kernel accepts for an interface, and takes as it is. Of one with
 * '%' it makes another one: "hc%d" becomes hc0, then hc1. */
static bool is_interface_name(const char *name)
{
    if (!*name || strlen(name) > INTERFACE_NAME_MAX || strcmp(name, ".") == 0 ||
        strcmp(name, "..") == 0)
        return false;
    for (; *name; name++)
        if (strchr("/:%", *name) || isspace((unsigned char)*name))
            return false;
    return true;
}

/* Returns true for a path that may appear in the log. */
static bool is_path(const char *path)
{
    const char *c = path;
    while (*c && !iscntrl((unsigned char)*c))
        c++;
    return *path && !*c;
}

/* Reads a descriptor in its only valid form, so that equal descriptors have equal names. 0, 1 and 2
 * are in use. */
static bool parse_fd(int *fd, const char *text)
{
    uint64_t number = 0;
    if (!text_take_uint(&number, &text, FD_MAX) || *text)
        return false;
    *fd = (int)number;
    return *fd > 2;
}

/* Reads [HOST:]PORT[/NAME]. */
static bool parse_tcp(portname *name, const char *text)
{
    const char *slash = strchr(text, '/');
    name->bus = slash ? slash + 1 : NULL;
    if (slash && (!*name->bus || strlen(name->bus) > PORTNAME_BUS_MAX ||
                  name->bus[strspn(name->bus, NAME_CHARS)]))
        return false;
    return address_parse(&name->address, text, slash ? (size_t)(slash - text) : strlen(text),
                         PORTNAME_TCP_DEFAULT);
}

void portname_print_tcp(char out[PORTNAME_TCP_MAX], const portname *name, const char *node)
{
    char address[ADDRESS_BYTES];
    address_print(address, &name->address);
    (void)snprintf(out, PORTNAME_TCP_MAX, "tcp:%s/%.*s", address, (int)PORTNAME_BUS_MAX,
                   name->bus ? name->bus : node);
}

/* Writes what is wrong with [HOST:]PORT[/NAME]. */
static void explain_tcp(char why[ADDRESS_WHY_BYTES], const char *text)
{
    const char *slash = strchr(text, '/');
    const size_t length = slash ? (size_t)(slash - text) : strlen(text);
    net_address address;
    if (address_parse(&address, text, length, PORTNAME_TCP_DEFAULT))
        (void)snprintf(why, ADDRESS_WHY_BYTES,
                       "tcp: expected a name of at most %u letters, digits, '-', '_' and '.' "
                       "behind '/', not '%.40s'", PORTNAME_BUS_MAX, slash ? slash + 1 : "");
    else
        (void)snprintf(why, ADDRESS_WHY_BYTES, "tcp: expected %s, not '%.*s'",
                       address_expected(text, length), (int)(length < 40 ? length : 40), text);
}

/* Writes what a port is like whose name is the word for its kind alone. */
static bool explain_kind(char why[ADDRESS_WHY_BYTES], const char *text)
{
    static const struct { const char *word, *expected; } kinds[] = {
        {"tcp", "tcp:[HOST:]PORT[/NAME]"},
        {"unix", "unix:PATH"},
        {"fd", "fd:NUMBER"},
        {"usb", "{ usb: INTERFACE }"},
        {"cannelloni", "cannelloni:udp,peer=HOST:PORT or cannelloni:tcp,listen=PORT"},
    };
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        if (strcmp(text, kinds[i].word) != 0)
            continue;
        (void)snprintf(why, ADDRESS_WHY_BYTES, "expected %s, not '%s' alone", kinds[i].expected,
                       text);
        return true;
    }
    return false;
}

bool portname_explain(char why[ADDRESS_WHY_BYTES], const char *text)
{
    char part[ADDRESS_WHY_BYTES];
    const char *tcp = behind(text, "tcp:"), *fd = behind(text, "fd:");
    tunnelname tunnel;
    const portname_kind kind = portname_parse(text).kind;
    if (kind == PORTNAME_INTERFACE)
        return explain_kind(why, text);
    const bool known = tcp || fd || behind(text, "unix:") || behind(text, TUNNELNAME_PREFIX);
    const bool is_wrong = kind == PORTNAME_INVALID && known;
    if (!is_wrong && !behind(text, "usb:"))
        return false;
    if (behind(text, "usb:"))
        (void)snprintf(why, ADDRESS_WHY_BYTES,
                       "an adapter is written as { usb: INTERFACE }, not '%.40s'", text);
    else if (behind(text, TUNNELNAME_PREFIX) && !tunnelname_read(&tunnel, text, part))
        (void)snprintf(why, ADDRESS_WHY_BYTES, "cannelloni: %.*s", (int)(sizeof part - 20), part);
    else if (tcp)
        explain_tcp(why, tcp);
    else if (fd)
        (void)snprintf(why, ADDRESS_WHY_BYTES,
                       "fd: expected a descriptor 3..999999 without leading zeros, not '%.40s'",
                       fd);
    else
        (void)snprintf(why, ADDRESS_WHY_BYTES, "unix: expected the path of a socket behind it");
    plain_make(why, '?'); /* a cut may have left half a character */
    return true;
}

portname portname_parse(const char *text)
{
    portname name = {.path = behind(text, "unix:"), .fd = -1};
    const char *number = behind(text, "fd:");
    const char *address = behind(text, "tcp:");
    tunnelname tunnel;
    const char *adapter = behind(text, "usb:");
    if (name.path)
        name.kind = is_path(name.path) ? PORTNAME_UNIX : PORTNAME_INVALID;
    else if (adapter) {
        name.path = adapter;
        name.kind = is_path(adapter) ? PORTNAME_USB : PORTNAME_INVALID;
    } else if (number)
        name.kind = parse_fd(&name.fd, number) ? PORTNAME_FD : PORTNAME_INVALID;
    else if (address)
        name.kind = parse_tcp(&name, address) ? PORTNAME_TCP : PORTNAME_INVALID;
    else if (behind(text, TUNNELNAME_PREFIX))
        name.kind = tunnelname_parse(&tunnel, text) ? PORTNAME_TUNNEL : PORTNAME_INVALID;
    else if (is_interface_name(text))
        name.kind = PORTNAME_INTERFACE;
    return name;
}

bool portname_is_interface(const char *text)
{
    return text && portname_parse(text).kind == PORTNAME_INTERFACE;
}

bool portname_is_shared(const char *text)
{
    const portname_kind kind = text ? portname_parse(text).kind : PORTNAME_INVALID;
    return kind == PORTNAME_UNIX || kind == PORTNAME_TCP;
}
