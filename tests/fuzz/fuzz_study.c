/* A study's JSON file on any bytes: refused with words, or drawn, and what is kept of it reads back. */
#include <stdlib.h>

#include "client/study/study_files.h"
#include "client/study/page/study_page.h"
#include "client/study/page/study_plot.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void draw(const struct study *s)
{
    struct buffer out = BUFFER_INIT;
    struct error err = {0};

    if (study_page(&out, s, &err) != STATUS_OK && err.code != STATUS_ERR_NO_MEMORY)
        abort();
    for (int f = 0; f < STUDY_FIGURES; f++)
        if (study_figure_has(s, (enum study_figure)f))
            study_figure_file(&out, s, (enum study_figure)f);
    study_csv(&out, s);
    buffer_release(&out);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct buffer kept = BUFFER_INIT;
    struct error err = {0};
    struct study s, back;

    study_init(&s);
    study_init(&back);
    if (study_read(&s, (const char *)data, size, "fuzz", &err) != STATUS_OK) {
        if (!err.text[0])
            abort(); /* every refusal says why */
    } else {
        draw(&s);
        if (study_write(&kept, &s, &err) == STATUS_OK &&
            study_read(&back, buffer_text(&kept), kept.size, "kept", &err) != STATUS_OK)
            abort();
    }
    buffer_release(&kept);
    study_release(&back);
    study_release(&s);
    return 0;
}
