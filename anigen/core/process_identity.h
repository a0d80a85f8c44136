#pragma once
#include <cstdint>
#include <string>

#include "anigen/core/json.h"

namespace anigen {

/// Who a process is, for files that several machines and containers share, where a process id alone means nothing.
struct ProcessIdentity {
  std::string host;           ///< for people
  std::string space;          ///< boot of the machine and process-id namespace: where `id` means something
  std::int64_t id = 0;        ///< process id
  std::uint64_t started = 0;  ///< in clock ticks since boot, which tells it from an earlier process of this id
};

ProcessIdentity this_process();

/// The process was in this machine's process-id namespace, and is not there any more; a zombie counts as gone. False
/// also where that cannot be told.
bool certainly_gone(const ProcessIdentity& process);

/// Where this process's loopback leads: boot of the machine and network namespace, the same for processes that reach each
/// other at 127.0.0.1; the name of the host where the system does not say.
std::string network_space();

/// A number for names of temporary files, different for every process that could write to the same folder. Decimal.
std::string process_number();

Json to_json(const ProcessIdentity& process);
/// @throws Json::exception when it is not what to_json() writes
ProcessIdentity process_identity_from_json(const Json& json);

}  // namespace anigen
