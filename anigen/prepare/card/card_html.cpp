#include "anigen/core/base64.h"
#include "anigen/core/html.h"
#include "anigen/prepare/card/card_pages.h"

namespace anigen::prepare {
namespace {

constexpr char kHead[] = R"(<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Dataset card</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1100px; margin: 2em auto; padding: 0 1em; color: #22252a; }
table { border-collapse: collapse; margin: 0.5em 0 1.5em; }
th, td { text-align: left; padding: 0.2em 1em 0.2em 0; border-bottom: 1px solid #dde0e5; vertical-align: top; }
td { overflow-wrap: anywhere; }
img { max-width: 100%; } svg { max-width: 100%; height: auto; }
svg rect { fill: #4878a8; } svg text { font-size: 11px; text-anchor: middle; fill: #555b66; }
pre { background: #f4f5f7; padding: 1em; overflow-x: auto; } .note { color: #555b66; }
</style></head><body>
<h1>Dataset card</h1>
)";

std::string html_table(const CardTable& table) {
  std::string html = "<h2>" + html_escaped(table.title) + "</h2>\n";
  if (!table.note.empty()) html += "<p class=\"note\">" + html_escaped(table.note) + "</p>\n";
  html += "<table><tr>";
  for (const std::string& name : table.columns) html += "<th>" + html_escaped(name) + "</th>";
  html += "</tr>\n";
  for (const auto& row : table.rows) {
    html += "<tr>";
    for (const std::string& cell : row) html += "<td>" + html_escaped(cell) + "</td>";
    html += "</tr>\n";
  }
  return html + "</table>\n";
}

}  // namespace

std::string card_html(const CardFacts& facts, const std::vector<std::string>& columns,
                      const std::vector<std::uint8_t>& picture) {
  CardTable counts{"Counts", "", {"", ""}, {}};
  for (const auto& [name, value] : facts.counts) counts.rows.push_back({name, value});
  std::string html = kHead + html_table(counts);
  if (!picture.empty()) {
    html += "<h2>Assets</h2>\n<img alt=\"assets of the dataset with their skeletons\" src=\"data:image/png;base64," +
            base64(picture) + "\">\n";
  }
  for (const CardHistogram& one : facts.histograms) {
    html += "<h2>" + html_escaped(one.title) + "</h2>\n<p class=\"note\">" + short_number(one.spread.least) + " to " +
            short_number(one.spread.most) + ", median " + short_number(one.spread.median) + ", mean " +
            short_number(one.spread.mean) + "</p>\n" + histogram_svg(one.bins);
  }
  for (const CardTable& table : facts.tables) {
    if (!table.rows.empty()) html += html_table(table);
  }
  html += "<h2>Columns of metadata.csv</h2>\n<p>";
  for (std::size_t i = 0; i < columns.size(); ++i) html += (i > 0 ? ", " : "") + html_escaped(columns[i]);
  html += "</p>\n<h2>How it was made</h2>\n<pre>" + html_escaped(facts.settings) + "</pre>\n</body></html>\n";
  return html;
}

}  // namespace anigen::prepare
