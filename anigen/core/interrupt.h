#pragma once

namespace anigen {

/// From now on SIGINT and SIGTERM only raise a flag that long work polls; a second signal ends the process at once.
void install_interrupt_handler();

bool interrupt_requested();

/// @throws Interrupted when the flag is up. Call where everything worth keeping has been saved.
void throw_if_interrupted();

}  // namespace anigen
