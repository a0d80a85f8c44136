#pragma once
#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace anigen {

/// A table of text with a header line, as metadata.csv is. Quoting follows RFC 4180.
struct CsvTable {
  std::vector<std::string> columns;
  std::vector<std::vector<std::string>> rows;  ///< every row as long as `columns`

  static constexpr std::size_t kMissing = static_cast<std::size_t>(-1);
  /// Index of a column, or kMissing.
  std::size_t column(std::string_view name) const;
  /// The cell, or an empty string when there is no such column.
  const std::string& cell(std::size_t row, std::string_view name) const;
  /// A clean boolean as pandas writes and reads it: True/true/1 or False/false/0.
  /// @param fallback what an absent column or an empty cell means @throws InputError on another word
  bool flag(std::size_t row, std::string_view name, bool fallback, const std::string& file) const;
};

/// One field, quoted when it holds a comma, a quote, a line break, or blanks at an end.
std::string csv_field(std::string_view text);

/// A boolean as pandas writes it: True or False.
std::string csv_flag(bool value);

/// Header and rows, lines ended by '\n'.
std::string to_csv(const CsvTable& table);

/// @param file only for messages @throws InputError naming the line: an unclosed quote, a row of another length,
/// a repeated column
CsvTable parse_csv(std::string_view text, const std::string& file);
CsvTable read_csv(const std::filesystem::path& path);

/// Text as it may stand in HTML, inside attributes too: & < > " become entities.
std::string html_escaped(const std::string& text);

/// A table of text for people.
struct Table {
  std::vector<std::string> columns;
  std::vector<std::vector<std::string>> rows;
};

/// Markdown with padded columns, so that it also reads well on a screen. Columns of numbers, other
/// than the first, are aligned to the right. Vertical bars inside cells are escaped.
std::string to_markdown(const Table& table);

/// A cell without the marks that tables put around the best (`**so**`) and the second best (`_so_`).
struct MarkedCell {
  std::string text;
  int place = 0;  ///< 1 best, 2 second best, 0 neither
};
MarkedCell without_marks(const std::string& cell);

/// An HTML <table>; cells are escaped, the best is bold, the second best in italics.
std::string to_html(const Table& table);

/// A LaTeX tabular (booktabs): the best is bold, the second best underlined; arrows, ± and dashes become LaTeX's.
std::string to_latex(const Table& table);

/// A number with up to so many significant digits, as %g writes it.
std::string significant(double value, int digits);

/// A number with so many digits after the point; "–" when it is not finite; what rounds to zero has no sign.
std::string fixed(double value, int digits = 4);

}  // namespace anigen
