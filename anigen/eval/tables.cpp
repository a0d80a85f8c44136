#include "anigen/eval/tables.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "anigen/core/html.h"

namespace anigen::eval {
namespace {

/// Characters, not bytes: what does not continue a UTF-8 sequence.
std::size_t width(const std::string& text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; }));
}

std::string markdown_cell(const std::string& text) {
  std::string cell;
  for (const char c : text) {
    if (c == '|') cell += '\\';
    cell += c == '\n' || c == '\r' ? ' ' : c;
  }
  return cell;
}

/// Does every cell of the column that is not empty start like a number, or stand for a missing one?
bool numeric(const Table& table, std::size_t column) {
  return std::all_of(table.rows.begin(), table.rows.end(), [column](const std::vector<std::string>& row) {
    const std::string& cell = row[column];
    return cell.empty() || cell == "–" || (cell[0] >= '0' && cell[0] <= '9') || cell[0] == '-';
  });
}

}  // namespace

std::string to_markdown(const Table& table) {
  std::vector<std::size_t> widths;
  for (const std::string& column : table.columns)
    widths.push_back(std::max<std::size_t>(3, width(markdown_cell(column))));
  for (const auto& row : table.rows) {
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], width(markdown_cell(row[i])));
  }
  std::vector<bool> right(table.columns.size(), false);
  for (std::size_t i = 1; i < right.size(); ++i) right[i] = numeric(table, i);
  std::string text;
  const auto line = [&](const std::vector<std::string>& cells) {
    text += '|';
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const std::string cell = markdown_cell(cells[i]);
      const std::string padding(widths[i] - width(cell), ' ');
      text += ' ' + (right[i] ? padding + cell : cell + padding) + " |";
    }
    text += '\n';
  };
  line(table.columns);
  text += '|';
  for (std::size_t i = 0; i < widths.size(); ++i) {
    text += ' ' + std::string(widths[i] - (right[i] ? 1 : 0), '-') + (right[i] ? ": |" : " |");
  }
  text += '\n';
  for (const auto& row : table.rows) line(row);
  return text;
}

MarkedCell without_marks(const std::string& cell) {
  if (cell.size() > 4 && cell.rfind("**", 0) == 0 && cell.compare(cell.size() - 2, 2, "**") == 0)
    return {cell.substr(2, cell.size() - 4), 1};
  if (cell.size() > 2 && cell.front() == '_' && cell.back() == '_') return {cell.substr(1, cell.size() - 2), 2};
  return {cell, 0};
}

std::string to_html(const Table& table) {
  std::string text = "<table>\n<tr>";
  for (const std::string& column : table.columns) text += "<th>" + html_escaped(column) + "</th>";
  text += "</tr>\n";
  for (const auto& row : table.rows) {
    text += "<tr>";
    for (const std::string& cell : row) {
      const MarkedCell marked = without_marks(cell);
      const std::string tag = marked.place == 1 ? "b" : marked.place == 2 ? "i" : "";
      const std::string inside = html_escaped(marked.text);
      text += "<td>" + (tag.empty() ? inside : "<" + tag + ">" + inside + "</" + tag + ">") + "</td>";
    }
    text += "</tr>\n";
  }
  return text + "</table>\n";
}

std::string fixed(double value, int digits) {
  if (!std::isfinite(value)) return "–";
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  const bool zero = std::string(text).find_first_not_of("-0.") == std::string::npos;
  return zero && text[0] == '-' ? text + 1 : text;
}

}  // namespace anigen::eval
