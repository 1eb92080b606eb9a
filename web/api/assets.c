#include "web/api/assets.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const struct web_asset_file *web_asset_find(const char *name)
{
    for (size_t i = 0; i < web_asset_file_count; i++)
        if (strcmp(web_asset_files[i].name, name) == 0)
            return &web_asset_files[i];
    return NULL;
}

int web_etag_matches(const char *if_none_match, const char *etag)
{
    const size_t size = strlen(etag);

    if (!if_none_match)
        return 0;
    for (const char *at = if_none_match; *at;) {
        at += strspn(at, " \t,");
        if (strncmp(at, "W/", 2) == 0)
            at += 2;
        if (*at == '*' || (strncmp(at, etag, size) == 0 && (!at[size] || strchr(" \t,", at[size]))))
            return 1;
        at += strcspn(at, ",");
    }
    return 0;
}

int web_accepts_gzip(const char *accept_encoding)
{
    for (const char *at = accept_encoding; at && *at; at += strcspn(at, ",")) {
        const char *quality;

        at += strspn(at, " \t,");
        if (strncmp(at, "gzip", 4) != 0 || (at[4] && !strchr(" \t,;", at[4])))
            continue;
        quality = at + 4 + strspn(at + 4, " \t;");
        return strncmp(quality, "q=", 2) != 0 || strtod(quality + 2, NULL) > 0.0;
    }
    return 0;
}

static void send(struct web_request *request, const char *name)
{
    const struct web_asset_file *file = web_asset_find(name);
    int packed = web_accepts_gzip(web_header(request, "accept-encoding"));
    struct error why;
    char headers[200], etag[64];

    if (!file) {
        (void)error_set(&why, STATUS_ERR_NOT_FOUND, "the page has no such file");
        web_fail(request, &why);
        return;
    }
    snprintf(etag, sizeof etag, "\"%s%s\"", file->etag, packed ? "-gz" : "");
    snprintf(headers, sizeof headers, "cache-control: no-cache\r\nvary: accept-encoding\r\netag: %s\r\n%s", etag,
             packed ? "content-encoding: gzip\r\n" : "");
    if (web_etag_matches(web_header(request, "if-none-match"), etag))
        web_answer(request, 304, NULL, headers, NULL, 0);
    else if (packed)
        web_answer(request, 200, file->type, headers, file->packed, file->packed_size);
    else
        web_answer(request, 200, file->type, headers, file->data, file->size);
}

void web_asset_index(struct web_request *request) { send(request, "index.html"); }

void web_asset(struct web_request *request) { send(request, request->parameters[0]); }

void web_asset_in_folder(struct web_request *request)
{
    char name[64];

    snprintf(name, sizeof name, "%s/%s", request->parameters[0], request->parameters[1]);
    send(request, name);
}

void web_asset_openapi(struct web_request *request) { send(request, "openapi.yaml"); }
