/* The page's own rules; those of the plots are in plot_style.c. */
#include "client/study/page/study_page.h"
#include "client/study/page/study_plot.h"

static const char rules[] =
    "*{box-sizing:border-box}\n"
    "html{-webkit-text-size-adjust:100%;text-size-adjust:100%}\n"
    "body{margin:0;background:$paper;color:$ink;font:15px/1.5 system-ui,'Segoe UI','Helvetica Neue',"
    "Arial,sans-serif}\n"
    ".page{max-width:1216px;margin:0 auto;padding:20px 24px 64px}\n"
    "h1{font-size:33px;line-height:1.18;letter-spacing:-.015em;font-weight:650;margin:2px 0 8px;"
    "max-width:36em;text-wrap:balance;overflow-wrap:anywhere}\n"
    "h2{font-size:22px;line-height:1.25;letter-spacing:-.01em;font-weight:650;margin:52px 0 6px}\n"
    "h3{font-size:15px;font-weight:650;margin:0 0 8px;overflow-wrap:anywhere}\n"
    "p{margin:0}\n"
    ".kicker,.small{color:$soft;font-size:13px;overflow-wrap:anywhere}\n"
    ".lead{max-width:74em}.lead .soft{color:$soft}\n"
    ".hint{color:$soft;max-width:70em;margin-bottom:18px}\n"
    "code{font:12px/1.5 ui-monospace,Menlo,Consolas,'DejaVu Sans Mono',monospace;color:inherit;"
    "overflow-wrap:anywhere}\n"
    ".first{display:grid;grid-template-columns:464px minmax(0,1fr);gap:32px;margin-top:14px;"
    "align-items:start}\n"
    ".first.alone{grid-template-columns:minmax(0,1fr);max-width:820px}\n"
    "figure{margin:0}\n"
    ".plot{display:block;width:100%;height:auto}\n"
    ".narrow{display:none}\n"
    ".region{width:fit-content;max-width:100%}.region+.region{margin-top:12px}\n"
    ".region h3{display:flex;justify-content:space-between;margin:0 0 6px;font-size:13px;color:$soft;font-weight:600}\n"
    ".crops{display:grid;grid-template-columns:repeat(3,minmax(0,auto));gap:8px 10px}\n"
    ".crops img{display:block;max-width:100%;height:auto;image-rendering:pixelated;border-radius:2px}\n"
    ".crops figcaption{font-size:13px;line-height:1.35;padding-top:4px;font-variant-numeric:tabular-nums}\n"
    ".region h3 span{font-weight:400;margin-left:.8em}.crops b{font-weight:600}.crops span{color:$soft}\n"
    ".trust{margin:10px 0 6px;padding:8px 14px;border-radius:6px;background:$okpaper;color:$okink;"
    "overflow-wrap:anywhere}\n"
    ".trust.doubt{background:$warnpaper;color:$warnink}\n"
    ".choices{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(340px,100%),1fr));"
    "gap:36px 32px;margin-top:4px}\n"
    ".choices article{break-inside:avoid}\n"
    ".says{list-style:none;margin:8px 0 0;padding:0;font-size:14px;line-height:1.45}\n"
    ".says li{padding-left:18px;position:relative;margin-top:5px;overflow-wrap:anywhere}\n"
    ".says li::before{content:'';position:absolute;left:0;top:.62em;width:11px;height:3px;"
    "border-radius:1px;background:$usual}\n"
    ".says .s1::before{background:$one}.says .s2::before{background:$two}"
    ".says .s3::before{background:$three}.says .s4::before{background:$four}\n"
    "details{margin-top:20px}\n"
    "summary{cursor:pointer;font-weight:600;padding:6px 0}\n"
    "details.experts{margin-top:56px;border-top:1px solid $faint;padding-top:14px}\n"
    "details.experts>summary{font-size:22px;letter-spacing:-.01em;font-weight:650}\n"
    "details h3{margin:32px 0 8px}\n"
    ".scroll{overflow-x:auto}\n"
    "table{border-collapse:collapse;font-size:13px;line-height:1.4;font-variant-numeric:tabular-nums}\n"
    "th{font-weight:600;color:$soft;text-align:right;vertical-align:bottom;padding:4px 14px 4px 0;"
    "border-bottom:1px solid $axis;white-space:nowrap}\n"
    "td{text-align:right;padding:4px 14px 4px 0;border-bottom:1px solid $grid;white-space:nowrap}\n"
    "th.words,td.words{text-align:left;white-space:normal;overflow-wrap:anywhere;min-width:7em}td.top{vertical-align:top}\n"
    ".pair{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(340px,100%),1fr));gap:24px 32px}\n"
    ".mapbox img{display:block;width:100%;height:auto;max-width:520px;image-rendering:pixelated;"
    "border:1px solid $faint}\n"
    "dl{display:grid;grid-template-columns:max-content minmax(0,1fr);gap:2px 18px;margin:0;font-size:13px}\n"
    "dt{color:$soft}dd{margin:0;overflow-wrap:anywhere}\n";

static const char phone[] = "@media(max-width:1000px){.first{grid-template-columns:minmax(0,1fr);gap:22px}"
                            ".first .crops{max-width:520px}}\n"
                            "@media(max-width:600px){.page{padding:14px 16px 48px}h1{font-size:26px}"
                            ".wide{display:none}.narrow{display:block}h2{margin-top:40px}"
                            ".crops figcaption{font-size:12px}}\n";

static const char print[] =
    "@page{size:A4;margin:14mm}\n"
    "@media print{body{font-size:10pt}.page{max-width:none;padding:0}h1{font-size:20pt}"
    ".first{display:block}.first>div{display:grid;grid-template-columns:1fr 1fr;gap:0 16px;"
    "margin-bottom:10px}.region+.region{margin:0}.region h3,.crops figcaption{font-size:7.5pt}"
    ".hint{break-after:avoid;break-inside:avoid}.sheet{break-before:page}.sheet h2{margin-top:0}.wide{display:block}.narrow{display:none}"
    ".choices{grid-template-columns:repeat(2,minmax(0,1fr));gap:20px}h2,h3{break-after:avoid}"
    "figure,.pair>div,tr{break-inside:avoid}.scroll{overflow:visible}"
    "table{font-size:7.5pt}th,td{padding-right:8px}"
    "*{-webkit-print-color-adjust:exact;print-color-adjust:exact}"
    "details::details-content{content-visibility:visible;display:block}"
    "summary{list-style:none}summary::marker{content:''}}\n";

void page_style(struct buffer *out)
{
    buffer_puts(out, "<style>\n:root{color-scheme:light dark;");
    study_style_variables(out, 0);
    buffer_puts(out, "}\n@media screen and (prefers-color-scheme:dark){:root{");
    study_style_variables(out, 1);
    buffer_puts(out, "}}\n");
    study_style_rules(out, rules, 1);
    study_style_rules(out, study_plot_rules, 1);
    buffer_puts(out, phone);
    buffer_puts(out, print);
    buffer_puts(out, "</style>\n");
}
