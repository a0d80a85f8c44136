#pragma once
#include <string>
#include <vector>

namespace anigen::eval {

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

/// A number with so many digits after the point; "–" when it is not finite; what rounds to zero has no sign.
std::string fixed(double value, int digits = 4);

}  // namespace anigen::eval
