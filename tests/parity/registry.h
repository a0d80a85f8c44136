#pragma once
#include <string>
#include <vector>

#include "tests/parity/fixture.h"

namespace anigen::test {

/// Computes the outputs of a fixture and checks them with Fixture::check.
using ParityHandler = void (*)(Fixture& fixture);

struct ParityEntry {
  std::string name;
  ParityHandler handler;
  bool on_device;  ///< computes on Fixture::device(); else on the host, whatever the device
};

/// All registered handlers, in no particular order.
std::vector<ParityEntry>& parity_entries();

/// The handler of this very name, else the one whose name is the longest prefix of it; nullptr when there is none.
const ParityEntry* find_parity_handler(const std::string& fixture);

struct ParityRegistration {
  ParityRegistration(const char* name, ParityHandler handler, bool on_device) {
    parity_entries().push_back({name, handler, on_device});
  }
};

/// Thrown by a handler for the part of a fixture that needs something not built yet; the test counts as skipped.
struct NotBuiltYet {
  std::string what;
};

}  // namespace anigen::test

/// Registers a handler: at the start of a line, since CMake lists the names from the sources.
#define ANIGEN_PARITY(name, handler) \
  static const ::anigen::test::ParityRegistration name##_registration(#name, handler, false);
/// As above, of a handler that computes on the fixture's device: with `--device` it is a test of that device, too.
#define ANIGEN_DEVICE_PARITY(name, handler) \
  static const ::anigen::test::ParityRegistration name##_registration(#name, handler, true);
