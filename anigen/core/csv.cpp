#include "anigen/core/csv.h"

#include <algorithm>
#include <utility>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"

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
    for (std::size_t i = 0; i < fields.size(); ++i) text += (i == 0 ? "" : ",") + csv_field(fields[i]);
    text += '\n';
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

}  // namespace anigen
