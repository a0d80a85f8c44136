#include "anigen/core/interrupt.h"

#include <csignal>

#include "anigen/core/error.h"

namespace anigen {
namespace {

volatile std::sig_atomic_t requested = 0;

void handle(int signal) {
  requested = 1;
  std::signal(signal, SIG_DFL);
}

}  // namespace

void install_interrupt_handler() {
  std::signal(SIGINT, handle);
  std::signal(SIGTERM, handle);
}

bool interrupt_requested() { return requested != 0; }

void throw_if_interrupted() {
  if (interrupt_requested()) throw Interrupted("interrupted; what was finished is saved");
}

}  // namespace anigen
