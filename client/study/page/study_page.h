/* study_page: the study as one HTML file that needs nothing else: no script, no font, no picture
 * from elsewhere. Its first screen is for everyone, the collapsed end for experts. */
#pragma once

#include "client/study/data/study_data.h"

status study_page(struct buffer *out, const struct study *s, struct error *err) MUST_CHECK;

/* ---- private to client/study ---- */
typedef void study_sayer(struct buffer *out, const struct study *s);
/* Append the text of `say`, escaped. */
void page_say(struct buffer *out, const struct study *s, study_sayer *say);
/* <img> with the picture inside; CSS pixels. */
status page_picture(struct buffer *out, const struct study_picture *picture, double width, double height,
                    const char *description, struct error *err) MUST_CHECK;
/* The pixels and tiles that hold the error, and where adaptive sampling puts its samples. */
status page_where(struct buffer *out, const struct study *s, struct error *err) MUST_CHECK;
void page_experts(struct buffer *out, const struct study *s);
void page_style(struct buffer *out);
