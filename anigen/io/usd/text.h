#pragma once
#include <Eigen/Core>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace anigen::io::usd_export {

/// Gives out USD identifiers (letters, digits and '_', no digit first), each once.
class Identifiers {
 public:
  /// The name with every character that an identifier may not have replaced by '_', and a number behind it where that
  /// was given out before. @param fallback for names of which nothing is left
  std::string make(std::string_view name, std::string_view fallback);

 private:
  std::set<std::string> taken_;
};

/// A text in quotes: UTF-8, without control characters.
std::string string_text(const std::string& text);

// Numbers in the fewest digits that give them back.
std::string number_text(float value);
std::string number_text(double value);

/// "(1, 2, 3)". Vector: any Eigen vector of float or double
template <typename Vector>
std::string tuple_text(const Vector& vector) {
  std::string text = "(";
  for (Eigen::Index k = 0; k < vector.size(); ++k) {
    if (k > 0) text += ", ";
    text += number_text(vector[k]);
  }
  return text + ")";
}

/// The format's matrices multiply rows from the right: the transposed of ours.
std::string matrix_text(const Eigen::Matrix4d& matrix);

/// "[a, b]" of texts made from each item.
template <typename Range, typename Text>
std::string array_text(const Range& items, Text text) {
  std::string line = "[";
  bool first = true;
  for (const auto& item : items) {
    if (!first) line += ", ";
    first = false;
    line += text(item);
  }
  return line + "]";
}

/// Lines of a .usda file, indented by the braces around them.
class Lines {
 public:
  void add(std::string_view line) {
    text_.append(4 * depth_, ' ');
    text_.append(line);
    text_ += '\n';
  }
  /// `line`, if any, and on a line of its own the brace below which lines are indented: a prim.
  void open(std::string_view line) {
    if (!line.empty()) add(line);
    open_behind("", '{');
  }
  /// `line` with the bracket behind it, as metadata and dictionaries are written: some readers go line by line.
  void open_behind(std::string_view line, char bracket) {
    add(std::string(line) + (line.empty() ? "" : " ") + bracket);
    ++depth_;
  }
  /// An attribute and its metadata.
  void add_with(std::string_view line, const std::vector<std::string>& metadata) {
    open_behind(line, '(');
    for (const std::string& one : metadata) add(one);
    close(')');
  }
  /// The name that something had before it got an identifier.
  void add_name(const std::string& name) {
    open_behind("customData =", '{');
    add("string name = " + string_text(name));
    close();
  }
  void close(char bracket = '}') {
    --depth_;
    add(std::string_view(&bracket, 1));
  }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
  std::size_t depth_ = 0;
};

}  // namespace anigen::io::usd_export
