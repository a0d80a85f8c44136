#include "anigen/experiment/input_fingerprint.h"

#include <algorithm>
#include <map>
#include <system_error>
#include <vector>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/sha256.h"

namespace anigen::experiment {
namespace {

namespace fs = std::filesystem;

std::string line_of(const fs::path& file, const std::string& name) {
  return name + " " + std::to_string(fs::file_size(file)) + " " +
         std::to_string(fs::last_write_time(file).time_since_epoch().count()) + "\n";
}

/// Clears so many bytes behind each place where a mark is found.
void clear_behind(std::string& bytes, const std::string& mark, std::size_t count) {
  for (std::size_t at = bytes.find(mark); at != std::string::npos; at = bytes.find(mark, at + mark.size())) {
    for (std::size_t i = at + mark.size(); i < std::min(bytes.size(), at + mark.size() + count); ++i) bytes[i] = '\0';
  }
}

/// The program's file without what changes although the code does not.
std::string code_of(std::string bytes) {
  // As cmake/AnigenVersion.cmake writes it; put together here, so that this program holds it once.
  const std::string mark = std::string("anigen ") + "commit: ";
  constexpr std::size_t kStamp = 64;
  clear_behind(bytes, mark, kStamp - mark.size());
  // The ELF note of 20 bytes that is called GNU and is of kind 3, a build id.
  clear_behind(bytes, std::string("\4\0\0\0\24\0\0\0\3\0\0\0GNU\0", 16), 20);
  return bytes;
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
  const fs::path module = program.parent_path().parent_path() / "lib" / "anigen" / "anigen-torch.so";
  // A change to networks must not make whole datasets anew: the steps of a preparation have versions of their own.
  const bool loads = program.filename() != "anigen-prepare" && fs::exists(module, error);
  const std::string state = program.string() + (fs::exists(program, error) ? input_fingerprint(program) : "") +
                            (loads ? input_fingerprint(module) : "");
  const auto found = known.find(state);
  if (found != known.end()) return found->second;
  if (!fs::is_regular_file(program, error))
    throw InputError(program.string(), "", "no such program; build it, or name its folder with --programs");
  const std::string own = sha256(code_of(read_file(program)));
  return known[state] = loads ? sha256(own + sha256(code_of(read_file(module)))) : own;
}

}  // namespace anigen::experiment
