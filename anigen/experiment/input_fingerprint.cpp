#include "anigen/experiment/input_fingerprint.h"

#include <algorithm>
#include <fstream>
#include <map>
#include <system_error>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/sha256.h"

namespace anigen::experiment {
namespace {

namespace fs = std::filesystem;

std::string line_of(const fs::path& file, const std::string& name) {
  return name + " " + std::to_string(fs::file_size(file)) + " " +
         std::to_string(fs::last_write_time(file).time_since_epoch().count()) + "\n";
}

}  // namespace

std::string input_fingerprint(const fs::path& path) {
  std::error_code error;
  if (fs::is_regular_file(path, error)) return sha256(line_of(path, path.filename().string()));
  if (!fs::is_directory(path, error)) throw InputError(path.string(), "", "no such file or folder");
  std::vector<std::string> lines;
  for (const auto& entry : fs::recursive_directory_iterator(path)) {
    if (entry.is_regular_file()) lines.push_back(line_of(entry.path(), fs::relative(entry.path(), path).string()));
  }
  std::sort(lines.begin(), lines.end());
  Sha256 all;
  for (const std::string& line : lines) all.update(line);
  return all.finish();
}

std::string program_fingerprint(const fs::path& program) {
  static std::map<std::string, std::string> known;  // by path, size and time
  std::error_code error;
  const std::string state = program.string() + (fs::exists(program, error) ? input_fingerprint(program) : "");
  const auto found = known.find(state);
  if (found != known.end()) return found->second;
  std::ifstream stream(program, std::ios::binary);
  if (!stream) throw InputError(program.string(), "", "no such program; build it, or name its folder with --programs");
  Sha256 digest;
  std::vector<char> piece(std::size_t{1} << 20);
  while (stream.read(piece.data(), static_cast<std::streamsize>(piece.size())), stream.gcount() > 0)
    digest.update({piece.data(), static_cast<std::size_t>(stream.gcount())});
  return known[state] = digest.finish();
}

}  // namespace anigen::experiment
