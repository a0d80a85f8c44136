#include "anigen/prepare/card/card_pages.h"

namespace anigen::prepare {
namespace {

/// A table cell: no line breaks, no column ends.
std::string cell_text(const std::string& text) {
  std::string cell;
  for (const char c : text) {
    if (c == '|') cell += '\\';
    cell += c == '\n' || c == '\r' ? ' ' : c;
  }
  return cell;
}

std::string row_text(const std::vector<std::string>& cells) {
  std::string line = "|";
  for (const std::string& cell : cells) line += " " + cell_text(cell) + " |";
  return line + "\n";
}

std::string markdown_table(const CardTable& table) {
  std::string text = "## " + table.title + "\n\n";
  if (!table.note.empty()) text += table.note + "\n\n";
  text += row_text(table.columns) + "|";
  for (std::size_t i = 0; i < table.columns.size(); ++i) text += "---|";
  text += "\n";
  for (const auto& row : table.rows) text += row_text(row);
  return text + "\n";
}

}  // namespace

std::string card_markdown(const CardFacts& facts, const std::vector<std::string>& columns, bool picture) {
  CardTable counts{"Counts", "", {"", ""}, {}};
  for (const auto& [name, value] : facts.counts) counts.rows.push_back({name, value});
  std::string text = "# Dataset card\n\n" + markdown_table(counts);
  if (picture) text += "## Assets\n\n![assets of the dataset with their skeletons](card.png)\n\n";
  for (const CardHistogram& one : facts.histograms) {
    text += "## " + one.title + "\n\n" + short_number(one.spread.least) + " to " + short_number(one.spread.most) +
            ", median " + short_number(one.spread.median) + ", mean " + short_number(one.spread.mean) + "\n\n```\n" +
            histogram_text(one.bins) + "```\n\n";
  }
  for (const CardTable& table : facts.tables) {
    if (!table.rows.empty()) text += markdown_table(table);
  }
  text += "## Columns of metadata.csv\n\n";
  for (std::size_t i = 0; i < columns.size(); ++i) text += (i > 0 ? ", `" : "`") + columns[i] + "`";
  return text + "\n\n## How it was made\n\n```json\n" + facts.settings + "\n```\n";
}

}  // namespace anigen::prepare
