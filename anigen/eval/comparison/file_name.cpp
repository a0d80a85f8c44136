#include "anigen/eval/comparison/file_name.h"

#include <cctype>
#include <cstdio>

#include "anigen/core/random.h"

namespace anigen::eval {

std::string file_name(const std::string& text) {
  std::string name;
  for (const char c : text.substr(0, 60))
    name += std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_' ? c : '_';
  char hash[20];
  std::snprintf(hash, sizeof hash, "-%08x", static_cast<unsigned>(stable_hash(text)));
  return name + hash;
}

}  // namespace anigen::eval
