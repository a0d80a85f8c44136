#include "anigen/core/table.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/text.h"

namespace anigen {

namespace {

/// Splits CSV text into records of fields, keeping the line each record starts on for messages.
class CsvScanner {
 public:
  CsvScanner(std::string_view text, std::string file) : text_(text), file_(std::move(file)) {
    if (text_.substr(0, 3) == "\xEF\xBB\xBF") position_ = 3;  // byte order mark of spreadsheet programs
  }

  bool next(std::vector<std::string>& record) {
    record.clear();
    if (position_ >= text_.size()) return false;
    start_line_ = line_;
    for (;;) {
      record.push_back(field());
      if (position_ >= text_.size()) return true;
      const char separator = text_[position_++];
      if (separator == ',') continue;
      if (separator == '\r' && position_ < text_.size() && text_[position_] == '\n') ++position_;
      ++line_;
      return true;
    }
  }

  [[noreturn]] void fail(const std::string& problem) const {
    throw InputError(file_, "line " + std::to_string(start_line_), problem);
  }

 private:
  std::string field() {
    std::string value;
    if (position_ < text_.size() && text_[position_] == '"') {
      ++position_;
      for (;; ++position_) {
        if (position_ >= text_.size()) fail("a quoted field is never closed");
        if (text_[position_] == '"') {
          if (position_ + 1 >= text_.size() || text_[position_ + 1] != '"') break;
          ++position_;
        }
        line_ += text_[position_] == '\n';
        value += text_[position_];
      }
      ++position_;
      if (position_ < text_.size() && !at_separator()) fail("text follows a closing quote");
      return value;
    }
    while (position_ < text_.size() && !at_separator()) value += text_[position_++];
    return value;
  }

  bool at_separator() const { return text_[position_] == ',' || text_[position_] == '\n' || text_[position_] == '\r'; }

  std::string_view text_;
  std::string file_;
  std::size_t position_ = 0, line_ = 1, start_line_ = 1;
};

/// Characters, not bytes: what does not continue a UTF-8 sequence.
std::size_t width(const std::string& text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; }));
}

std::string markdown_cell(const std::string& text) {
  return replaced_characters(text, {{'|', "\\|"}, {'\n', " "}, {'\r', " "}});
}

/// Does every cell of the column that is not empty start like a number, or stand for a missing one?
bool numeric(const Table& table, std::size_t column) {
  return std::all_of(table.rows.begin(), table.rows.end(), [column](const std::vector<std::string>& row) {
    const std::string& cell = row[column];
    return cell.empty() || cell == "–" || (cell[0] >= '0' && cell[0] <= '9') || cell[0] == '-';
  });
}

std::string escaped(const std::string& text) {
  std::string result = replaced_characters(text, {{'\\', "\\textbackslash{}"},
                                                  {'~', "\\textasciitilde{}"},
                                                  {'^', "\\textasciicircum{}"},
                                                  {'&', "\\&"},
                                                  {'%', "\\%"},
                                                  {'$', "\\$"},
                                                  {'#', "\\#"},
                                                  {'_', "\\_"},
                                                  {'{', "\\{"},
                                                  {'}', "\\}"}});
  constexpr const char* kSigns[][2] = {
      {"±", "$\\pm$"}, {"↓", "$\\downarrow$"}, {"↑", "$\\uparrow$"}, {"–", "--"}, {"…", "\\dots{}"}};
  for (const auto& [sign, latex] : kSigns) replace_all(result, sign, latex);
  return result;
}

std::string cell_of(const std::string& cell) {
  const MarkedCell marked = without_marks(cell);
  const std::string text = escaped(marked.text);
  if (marked.place == 1) return "\\textbf{" + text + "}";
  return marked.place == 2 ? "\\underline{" + text + "}" : text;
}

std::string line_of(const std::vector<std::string>& cells) { return joined(cells, " & ", cell_of) + " \\\\\n"; }

}  // namespace

std::size_t CsvTable::column(std::string_view name) const {
  const auto found = std::find(columns.begin(), columns.end(), name);
  return found == columns.end() ? kMissing : static_cast<std::size_t>(found - columns.begin());
}

const std::string& CsvTable::cell(std::size_t row, std::string_view name) const {
  static const std::string empty;
  const std::size_t index = column(name);
  return index == kMissing ? empty : rows[row][index];
}

bool CsvTable::flag(std::size_t row, std::string_view name, bool fallback, const std::string& file) const {
  const std::string& text = cell(row, name);
  if (text.empty()) return fallback;
  if (text == "True" || text == "true" || text == "1") return true;
  if (text == "False" || text == "false" || text == "0") return false;
  throw InputError(file, "row " + std::to_string(row + 1) + ", column " + std::string(name),
                   "expected True or False, got \"" + text + "\"");
}

std::string csv_field(std::string_view text) {
  const bool blank_end = !text.empty() && (text.front() == ' ' || text.back() == ' ');
  if (!blank_end && text.find_first_of(",\"\r\n") == std::string_view::npos) return std::string(text);
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"') quoted += '"';
    quoted += c;
  }
  return quoted + '"';
}

std::string csv_flag(bool value) { return value ? "True" : "False"; }

std::string to_csv(const CsvTable& table) {
  std::string text;
  const auto line = [&text](const std::vector<std::string>& fields) {
    // A lone empty field would read back as an empty line.
    if (fields.size() == 1 && fields[0].empty()) text += "\"\"";
    text += joined(fields, ",", csv_field) + '\n';
  };
  line(table.columns);
  for (const auto& row : table.rows) line(row);
  return text;
}

CsvTable parse_csv(std::string_view text, const std::string& file) {
  CsvScanner scanner(text, file);
  CsvTable table;
  if (!scanner.next(table.columns)) throw InputError(file, "line 1", "empty: expected a header line");
  for (std::size_t i = 0; i < table.columns.size(); ++i) {
    if (table.column(table.columns[i]) != i) scanner.fail("column \"" + table.columns[i] + "\" appears twice");
  }
  std::vector<std::string> record;
  while (scanner.next(record)) {
    if (record.size() == 1 && record[0].empty() && table.columns.size() > 1) continue;  // blank line
    if (record.size() != table.columns.size()) {
      scanner.fail(std::to_string(record.size()) + " fields where the header names " +
                   std::to_string(table.columns.size()));
    }
    table.rows.push_back(record);
  }
  return table;
}

CsvTable read_csv(const std::filesystem::path& path) { return parse_csv(read_file(path), path.string()); }

std::string html_escaped(const std::string& text) {
  return replaced_characters(text, {{'&', "&amp;"}, {'<', "&lt;"}, {'>', "&gt;"}, {'"', "&quot;"}});
}

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
  for (std::size_t i = 0; i < widths.size(); ++i)
    text += ' ' + std::string(widths[i] - (right[i] ? 1 : 0), '-') + (right[i] ? ": |" : " |");
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

std::string significant(double value, int digits) {
  char text[64];
  std::snprintf(text, sizeof text, "%.*g", digits, value);
  return text;
}

std::string fixed(double value, int digits) {
  if (!std::isfinite(value)) return "–";
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  const bool zero = std::string(text).find_first_not_of("-0.") == std::string::npos;
  return zero && text[0] == '-' ? text + 1 : text;
}

std::string to_latex(const Table& table) {
  if (table.columns.empty()) return "";
  std::string text = "% needs \\usepackage{booktabs}\n\\begin{tabular}{l" + std::string(table.columns.size() - 1, 'r') +
                     "}\n\\toprule\n" + line_of(table.columns) + "\\midrule\n";
  for (const auto& row : table.rows) text += line_of(row);
  return text + "\\bottomrule\n\\end{tabular}\n";
}

}  // namespace anigen
