/* SPDX-License-Identifier: MIT
 *
 * tunnelname.c - the name of a port that is the end of a tunnel to another machine.
 */
#include "config/node/tunnelname.h"

#include "base/text/nearest.h"
#include "base/text/number.h"
#include "base/text/plain.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define MTU_DEFAULT 1472u /* of Ethernet, without the heads of IPv4 and UDP */
#define MTU_MIN 80u       /* for the longest frame, 5 + 70 bytes */
#define MTU_MAX 65507u    /* of UDP */
#define TIMEOUT_DEFAULT_NS UINT64_C(1000000)
#define TIMEOUT_MAX_NS UINT64_C(1000000000)
#define NS_PER_US 1000u
#define VALUE_BYTES (ADDRESS_BYTES + 1u)

/* A key with its value. */
typedef struct pair {
    char key[16];
    char value[VALUE_BYTES];
} pair;

/* A name that is being read. */
typedef struct reading {
    tunnelname *name;
    bool listens; /* `listen` is there ... */
    bool host;    /* ... with an address */
    char *why;    /* takes the reason of a failure */
} reading;

/* Writes what is wrong. Returns false. */
__attribute__((format(printf, 2, 3))) static bool wrong(reading *r, const char *format, ...)
{
    va_list values;
    va_start(values, format);
    (void)vsnprintf(r->why, ADDRESS_WHY_BYTES, format, values);
    va_end(values);
    plain_make(r->why, '?'); /* a cut may have left half a character */
    return false;
}

static bool wrong_value(reading *r, const pair *p, const char *expected)
{
    return wrong(r, "%s: expected %s, not '%.40s'", p->key, expected, p->value);
}

static const char *transport(const reading *r)
{
    return r->name->tcp ? "tcp" : "udp";
}

/* Takes KEY=VALUE up to the next comma. Returns the text behind it, NULL for something else. */
static const char *take_pair(reading *r, pair *out, const char *text)
{
    const size_t length = strcspn(text, ",");
    const size_t key = strcspn(text, "=,");
    if (key == length || key >= sizeof out->key || length - key > sizeof out->value) {
        (void)wrong(r, "expected KEY=VALUE behind a comma, not '%.*s'",
                    (int)(length < 40 ? length : 40), text);
        return NULL;
    }
    (void)snprintf(out->key, sizeof out->key, "%.*s", (int)key, text);
    (void)snprintf(out->value, sizeof out->value, "%.*s", (int)(length - key - 1), text + key + 1);
    return text + length;
}

/* Takes the address of one end, which a name has once at most. The port has a default. */
static bool take_address(reading *r, net_address *out, bool *has, const pair *p)
{
    const size_t length = strlen(p->value);
    if (*has)
        return wrong(r, "%s: there is such an address already", p->key);
    *has = true;
    if (length > 0 && address_parse(out, p->value, length, TUNNELNAME_PORT_DEFAULT))
        return true;
    return wrong_value(r, p, address_expected(p->value, length));
}

/* Takes the time after which frames that wait for others are sent: whole microseconds, as with the
 * tool cannelloni. */
static bool take_timeout(reading *r, const pair *p)
{
    cfg_time time;
    if (text_parse_time(&time, p->value) || time.bits > 0 || time.ns > TIMEOUT_MAX_NS ||
        time.ns % NS_PER_US != 0)
        return wrong_value(r, p, "a time from 0 to 1s in whole microseconds, such as 1ms");
    r->name->timeout_ns = time.ns;
    return true;
}

/* Takes the most bytes that a packet may have. The longest frame must fit into one. */
static bool take_mtu(reading *r, const pair *p)
{
    uint64_t mtu;
    if (text_parse_uint(&mtu, p->value) || mtu < MTU_MIN || mtu > MTU_MAX)
        return wrong_value(r, p, "bytes 80..65507");
    r->name->mtu = (unsigned)mtu;
    return true;
}

/* Complains about a key that a tunnel does not have. */
static bool unknown(reading *r, const pair *p)
{
    static const char *const keys[] = {"listen", "peer", "timeout", "mtu", "connect"};
    nearest guess = {.word = p->key};
    for (size_t i = 0; i < sizeof keys / sizeof keys[0] - !r->name->tcp; i++)
        nearest_consider(&guess, keys[i]);
    if (guess.best)
        return wrong(r, "unknown key '%s' (did you mean '%s'?)", p->key, guess.best);
    return wrong(r, "unknown key '%s'; %s has listen, peer, timeout, mtu%s", p->key, transport(r),
                 r->name->tcp ? ", connect" : "");
}

/* Takes a pair key=value of the name of a tunnel. */
static bool tunnelname_take(reading *r, const pair *p)
{
    tunnelname *name = r->name;
    if (strcmp(p->key, "listen") == 0) {
        r->host = p->value[strspn(p->value, "0123456789")] != '\0';
        return take_address(r, &name->listen, &r->listens, p);
    }
    if (strcmp(p->key, "peer") == 0)
        return take_address(r, &name->peer, &name->has_peer, p);
    if (strcmp(p->key, "connect") == 0 && name->tcp) {
        name->connects = true;
        return take_address(r, &name->peer, &name->has_peer, p);
    }
    if (strcmp(p->key, "timeout") == 0)
        return take_timeout(r, p);
    return strcmp(p->key, "mtu") == 0 ? take_mtu(r, p) : unknown(r, p);
}

/* The own end of a UDP tunnel to another machine has any address of this one. Only packets of the
 * peer are taken. */
static void complete_host(tunnelname *name)
{
    const bool six = strchr(name->peer.host, ':') != NULL;
    const char *peer = name->peer.host;
    if (strncmp(peer, "127.", 4) == 0 || strcmp(peer, "::1") == 0)
        strcpy(name->listen.host, six ? "::1" : "127.0.0.1");
    else
        strcpy(name->listen.host, six ? "::" : "0.0.0.0");
}

/* Returns true when the ends of a tunnel fit: UDP needs a peer, and of TCP one end connects. */
static bool tunnelname_fits(reading *r)
{
    const tunnelname *name = r->name;
    const bool six = strchr(name->listen.host, ':') != NULL;
    if (!name->tcp && !name->has_peer)
        return wrong(r, "udp needs peer=HOST[:PORT]");
    if (name->tcp && name->connects == r->listens)
        return wrong(r, "tcp needs either listen=[HOST:]PORT or connect=HOST[:PORT]");
    if (name->has_peer && !name->connects && six != (strchr(name->peer.host, ':') != NULL))
        return wrong(r, "listen and peer: one is an IPv4 address, the other one an IPv6 address");
    return true;
}

/* Returns the text behind the transport, which comes first; NULL for something else. */
static const char *take_transport(reading *r, const char *text)
{
    const char *rest = text + strlen(TUNNELNAME_PREFIX);
    const size_t length = strcspn(rest, ",");
    r->name->tcp = length == 3 && strncmp(rest, "tcp", length) == 0;
    if (r->name->tcp || (length == 3 && strncmp(rest, "udp", length) == 0))
        return rest + length;
    (void)wrong(r, "expected udp or tcp first, not '%.*s'", (int)(length < 40 ? length : 40), rest);
    return NULL;
}

bool tunnelname_read(tunnelname *out, const char *text, char why[ADDRESS_WHY_BYTES])
{
    reading r = {.name = out, .why = why};
    pair p;
    *out = (tunnelname){.timeout_ns = TIMEOUT_DEFAULT_NS, .mtu = MTU_DEFAULT};
    (void)address_parse(&out->listen, "", 0, TUNNELNAME_PORT_DEFAULT);
    text = take_transport(&r, text);
    while (text && *text) {
        text = take_pair(&r, &p, text + 1);
        if (!text || !tunnelname_take(&r, &p))
            return false;
    }
    if (text && !out->tcp && !r.host && out->has_peer)
        complete_host(out);
    return text && tunnelname_fits(&r);
}

bool tunnelname_parse(tunnelname *out, const char *text)
{
    char why[ADDRESS_WHY_BYTES];
    return tunnelname_read(out, text, why);
}

void tunnelname_print(char out[TUNNELNAME_BYTES], const tunnelname *name)
{
    char listen[ADDRESS_BYTES], peer[ADDRESS_BYTES];
    address_print(listen, &name->listen);
    address_print(peer, &name->peer);
    const bool listens = !name->connects;
    (void)snprintf(out, TUNNELNAME_BYTES,
                   TUNNELNAME_PREFIX "%s%s%s%s%s,timeout=%" PRIu64 "us,mtu=%u",
                   name->tcp ? "tcp" : "udp", listens ? ",listen=" : "", listens ? listen : "",
                   !name->has_peer ? "" : name->connects ? ",connect=" : ",peer=",
                   name->has_peer ? peer : "", name->timeout_ns / NS_PER_US, name->mtu);
}
