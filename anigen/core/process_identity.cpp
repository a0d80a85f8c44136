#include "anigen/core/process_identity.h"

#include <unistd.h>

#include <fstream>
#include <sstream>
#include <system_error>

#include "anigen/core/random.h"

namespace anigen {
namespace {

/// What /proc/<id>/stat says behind the program's name, which may hold blanks and brackets itself.
struct ProcessState {
  char state = 0;  ///< 0: there is no such process, or nobody says
  std::uint64_t started = 0;
};

ProcessState state_of(std::int64_t id) {
  constexpr int kFieldsBetween = 18;  // from the state, field 3, to the time of the start, field 22
  std::ifstream file("/proc/" + std::to_string(id) + "/stat");
  std::string line;
  if (!std::getline(file, line)) return {};
  const std::size_t name_end = line.rfind(')');
  if (name_end == std::string::npos) return {};
  std::istringstream fields(line.substr(name_end + 1));
  ProcessState found;
  std::string skipped;
  fields >> found.state;
  for (int i = 0; i < kFieldsBetween; ++i) fields >> skipped;
  fields >> found.started;
  return fields ? found : ProcessState{};
}

/// @param kind of namespace, as in /proc/self/ns
std::string read_space(const char* kind) {
  std::ifstream file("/proc/sys/kernel/random/boot_id");
  std::string boot;
  std::getline(file, boot);
  char name[64];
  const ssize_t size = ::readlink((std::string("/proc/self/ns/") + kind).c_str(), name, sizeof name);
  return boot.empty() || size <= 0 ? "" : boot + "/" + std::string(name, static_cast<std::size_t>(size));
}

std::string read_host() {
  char name[256] = {};
  return ::gethostname(name, sizeof name - 1) == 0 ? name : "unknown";
}

}  // namespace

ProcessIdentity this_process() {
  // Of the machine, and so the same after a fork.
  static const std::string host = read_host(), space = read_space("pid");
  ProcessIdentity process{host, space, ::getpid(), 0};
  process.started = state_of(process.id).started;
  return process;
}

bool certainly_gone(const ProcessIdentity& process) {
  const ProcessIdentity here = this_process();
  if (process.space.empty() || process.space != here.space || here.started == 0) return false;
  const ProcessState found = state_of(process.id);
  return found.state == 0 || found.state == 'Z' || found.state == 'X' || found.started != process.started;
}

std::string network_space() {
  const std::string space = read_space("net");
  return space.empty() ? read_host() : space;
}

std::string process_number() {
  // Kept, since it names every file that is written; asked for anew after a fork.
  thread_local std::int64_t of_process = -1;
  thread_local std::string number;
  if (of_process != ::getpid()) {
    const ProcessIdentity process = this_process();
    of_process = process.id;
    number = std::to_string(stable_hash(to_json(process).dump()));
  }
  return number;
}

Json to_json(const ProcessIdentity& process) {
  return {{"host", process.host}, {"space", process.space}, {"id", process.id}, {"started", process.started}};
}

ProcessIdentity process_identity_from_json(const Json& json) {
  return {json.at("host").get<std::string>(), json.at("space").get<std::string>(), json.at("id").get<std::int64_t>(),
          json.at("started").get<std::uint64_t>()};
}

}  // namespace anigen
