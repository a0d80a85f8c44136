#include "anigen/io/rigs/shape_source.h"

namespace anigen::io {

std::vector<std::filesystem::path> ShapeSource::files(const std::string&) const { return {}; }

std::vector<std::string> ShapeSource::other_names(const std::string&) const { return {}; }

std::string ShapeSource::sample_id(const std::string&) const { return ""; }

std::string ShapeSource::category(const std::string&) const { return ""; }

bool ShapeSource::is_usable(const std::string&) const { return true; }

}  // namespace anigen::io
