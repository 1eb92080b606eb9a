/* key_matrix: send every message of the protocol with one key, and compare what becomes of it with
 * common/schema/requests.h.
 *
 *   key_matrix HOST PORT KEYFILE ROLE     ROLE: worker, client, admin, web; the side that the key speaks for
 *
 * The messages are those of the Envelope's descriptor, so a new one is sent, too: it must have a row in the table. Each
 * goes over a connection of its own, after the Hello; a Welcome follows it, which nobody may send: its refusal says that
 * the connection outlived the message. A line for each difference, then "N messages, M taken, D differ". */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <uv.h>

#include "common/math/elementary.h"
#include "common/schema/requests.h"
#include "protocol/message.h"
#include "worker/render/render.h"

enum { ASKED = 7, LAST = 8 };

struct probe {
    struct channel *channel;
    const ProtobufCFieldDescriptor *field;
    int collects; /* a StoreQuery that does */
    int welcomed, refused, over;
    char text[256];
};

static const struct farm_key *the_key;
static enum farm_role the_role;

static void die(const char *what)
{
    fprintf(stderr, "key_matrix: %s\n", what);
    exit(2);
}

static void send_named(struct probe *p, const ProtobufCFieldDescriptor *field, uint64_t request)
{
    const ProtobufCMessageDescriptor *type = field->descriptor;
    Azulejo__Wire__Envelope e = AZULEJO__WIRE__ENVELOPE__INIT;
    ProtobufCMessage *body = calloc(1, type->sizeof_message);

    if (!body)
        die("out of memory");
    protobuf_c_message_init(type, body);
    e.request = request;
    e.body_case = (Azulejo__Wire__Envelope__BodyCase)field->id;
    memcpy((char *)&e + field->offset, &body, sizeof body);
    if (p->collects && e.body_case == AZULEJO__WIRE__ENVELOPE__BODY_STORE_QUERY)
        e.store_query->collect = 1;
    if (channel_send(p->channel, &e) != STATUS_OK)
        p->over = 1;
    free(body);
}

static void on_open(struct channel *channel, void *user)
{
    static unsigned count;
    struct probe *p = user;
    Azulejo__Wire__Hello hello = AZULEJO__WIRE__HELLO__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(HELLO, hello, &hello);
    char name[32];

    snprintf(name, sizeof name, "m%u", ++count); /* a worker that broke a rule is blocked by its name */
    hello.protocol_version = PROTOCOL_VERSION;
    hello.role = (Azulejo__Wire__Role)the_role;
    hello.software = (char *)"key_matrix";
    hello.host = (char *)"matrix";
    hello.process = (uint32_t)getpid();
    hello.threads = 1;
    hello.arithmetic = elementary_fingerprint();
    hello.kernel = (char *)render_ray_tracer_name();
    hello.name = the_role == FARM_ROLE_WORKER ? name : (char *)"";
    hello.name_chosen = 1;
    if (channel_send(channel, &e) != STATUS_OK)
        p->over = 1;
}

static void on_message(struct channel *channel, const Azulejo__Wire__Envelope *m, void *user)
{
    struct probe *p = user;

    if (!p->welcomed && m->body_case == AZULEJO__WIRE__ENVELOPE__BODY_WELCOME) {
        p->welcomed = 1;
        send_named(p, p->field, ASKED);
        send_named(p, protobuf_c_message_descriptor_get_field_by_name(&azulejo__wire__envelope__descriptor, "welcome"), LAST);
        return;
    }
    if (m->body_case != AZULEJO__WIRE__ENVELOPE__BODY_FAILURE)
        return;
    if (!p->welcomed)
        die(m->failure->text);
    if (m->request == ASKED && m->failure->code == STATUS_ERR_REFUSED &&
        (strstr(m->failure->text, "may not send") || strstr(m->failure->text, " of the role "))) {
        p->refused = 1;
        message_text(p->text, sizeof p->text, m->failure->text);
    }
    if (m->request == LAST)
        channel_close(channel);
}

static void on_close(struct channel *channel UNUSED, const struct error *why UNUSED, void *user)
{
    ((struct probe *)user)->over = 1;
}

/* What requests.h says of that key. */
static int is_allowed(const struct request_rule *rule, int collects)
{
    const struct key_identity id = the_key->is_farm ? key_identity_shared(the_role) : the_key->id;
    enum web_role may = id.role == FARM_ROLE_WEB ? WEB_ROLE_ADMIN : id.may;

    if (rule->from == REQUEST_FROM_ANYBODY)
        return 1;
    if (id.role == FARM_ROLE_WORKER)
        return (rule->from & REQUEST_FROM_WORKERS) != 0;
    if (rule->from & REQUEST_FROM_PAGE)
        return id.role == FARM_ROLE_WEB;
    if (!(rule->from & REQUEST_FROM_PEOPLE))
        return 0;
    if (collects)
        rule = &request_rules[REQUEST_STORE_COLLECT];
    return may >= rule->role || (rule->own && may >= WEB_ROLE_SUBMIT);
}

/* 1: as the table says. */
static int try_message(uv_loop_t *loop, const char *host, uint16_t port, const ProtobufCFieldDescriptor *field,
                       int collects, int *taken)
{
    static const struct channel_callbacks callbacks = {on_open, on_message, NULL, on_close};
    const struct request_rule *rule = request_find(field->name);
    struct probe p = {.field = field, .collects = collects};
    struct error err = {0};

    if (!rule) {
        printf("%s has no row in common/schema/requests.h\n", field->name);
        return 0;
    }
    if (channel_connect(&p.channel, loop, host, port, the_key, the_role, &callbacks, &p, &err) != STATUS_OK)
        die(err.text);
    while (!p.over)
        uv_run(loop, UV_RUN_ONCE);
    uv_run(loop, UV_RUN_DEFAULT);
    if (!p.welcomed)
        die("the coordinator did not welcome the key");
    *taken += !p.refused;
    if (is_allowed(rule, collects) == !p.refused)
        return 1;
    printf("%s%s: %s\n", field->name, collects ? " (collect)" : "", p.refused ? p.text : "was taken, and must not be");
    return 0;
}

int main(int argc, char **argv)
{
    const ProtobufCMessageDescriptor *envelope = &azulejo__wire__envelope__descriptor;
    struct farm_key key;
    struct error err = {0};
    int messages = 0, taken = 0, differ = 0;
    uv_loop_t loop;

    if (argc != 5)
        die("usage: key_matrix HOST PORT KEYFILE ROLE");
    if (farm_key_load(&key, argv[3], &err) != STATUS_OK)
        die(err.text);
    for (int r = FARM_ROLE_WORKER; r < FARM_ROLE_COUNT; r++)
        if (strcmp(argv[4], farm_role_name((enum farm_role)r)) == 0)
            the_role = (enum farm_role)r;
    the_key = &key;
    uv_loop_init(&loop);
    for (unsigned i = 0; i < envelope->n_fields; i++) {
        const ProtobufCFieldDescriptor *field = &envelope->fields[i];
        /* A connection begins with the one Hello that there may be. */
        if (field->type != PROTOBUF_C_TYPE_MESSAGE || strcmp(field->name, "hello") == 0)
            continue;
        for (int collects = 0; collects < (strcmp(field->name, "store_query") == 0 ? 2 : 1); collects++) {
            messages++;
            differ += !try_message(&loop, argv[1], (uint16_t)atoi(argv[2]), field, collects, &taken);
        }
    }
    printf("%d messages, %d taken, %d differ\n", messages, taken, differ);
    if (uv_loop_close(&loop) != 0)
        die("a handle is still open");
    return differ > 0;
}
