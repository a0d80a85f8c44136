#include "anigen/engine/option_names.h"

#include <cctype>
#include <cstddef>

namespace anigen::engine {

std::string in_library_words(const std::string& message, OptionNames names) {
  std::string text;
  std::size_t done = 0;
  for (std::size_t begin = message.find("--"); begin != std::string::npos; begin = message.find("--", done)) {
    std::size_t end = begin + 2;
    while (end < message.size() && (std::islower(static_cast<unsigned char>(message[end])) != 0 || message[end] == '-'))
      ++end;
    const std::string_view option = std::string_view(message).substr(begin, end - begin);
    std::string_view word = option;
    for (const OptionName& name : names) {
      if (name.program == option) word = name.library;
    }
    text.append(message, done, begin - done).append(word);
    done = end;
  }
  return text.append(message, done, std::string::npos);
}

void throw_in_library_words(const InputError& error, OptionNames names) {
  constexpr std::string_view kNotSupported = "not supported: ";
  const std::string place = in_library_words(error.place(), names);
  std::string problem = in_library_words(error.problem(), names);
  // A file may have a name like that; an option that stands in its place is all there is.
  const bool is_option = error.file().rfind("--", 0) == 0 && error.file().find('/') == std::string::npos;
  const std::string file = is_option ? in_library_words(error.file(), names) : error.file();
  if (place == error.place() && problem == error.problem() && file == error.file()) return;
  if (dynamic_cast<const NotSupportedError*>(&error) != nullptr)
    throw NotSupportedError(file, place, problem.erase(0, kNotSupported.size()));
  throw InputError(file, place, problem);
}

}  // namespace anigen::engine
