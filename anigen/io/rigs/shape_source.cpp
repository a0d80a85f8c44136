#include "anigen/io/rigs/shape_source.h"

namespace anigen::io {

std::vector<std::filesystem::path> ShapeSource::files(const std::string&) const { return {}; }

std::vector<std::string> ShapeSource::other_names(const std::string&) const { return {}; }

std::string ShapeSource::sample_id(const std::string&) const { return ""; }

std::string ShapeSource::category(const std::string&) const { return ""; }

bool ShapeSource::is_usable(const std::string&) const { return true; }

std::set<std::string> short_names(const ShapeSource& source, const std::string& id) {
  const std::vector<std::string> others = source.other_names(id);
  std::set<std::string> names(others.begin(), others.end());
  names.insert(id.substr(id.rfind('/') + 1));  // all of it without a slash: npos + 1 is 0
  return names;
}

}  // namespace anigen::io
