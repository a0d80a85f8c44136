#pragma once
#include <cstddef>
#include <string>
#include <string_view>

#include "anigen/core/error.h"

namespace anigen::engine {

/// Option of a program and the library's name for it: "--clean" and "cleaning".
struct OptionName {
  std::string_view program, library;
};

/// A table of them, which must outlive this view.
class OptionNames {
 public:
  template <std::size_t N>
  constexpr OptionNames(const OptionName (&names)[N]) : begin_(names), end_(names + N) {}
  constexpr const OptionName* begin() const { return begin_; }
  constexpr const OptionName* end() const { return end_; }

 private:
  const OptionName *begin_, *end_;
};

/// A message of code that programs share, with the library's names of options. Options that the library lacks stay.
std::string in_library_words(const std::string& message, OptionNames names);

/// Throws the error with the library's names of options, if it names any of the program's.
void throw_in_library_words(const InputError& error, OptionNames names);

/// Calls work, whose InputErrors get the library's names of options.
template <typename Work>
auto with_library_words(OptionNames names, const Work& work) {
  try {
    return work();
  } catch (const InputError& error) {
    throw_in_library_words(error, names);
    throw;
  }
}

}  // namespace anigen::engine
