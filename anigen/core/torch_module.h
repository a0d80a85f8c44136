#pragma once

namespace anigen {

/// Loads the module with everything that needs LibTorch, `anigen-torch.so` (core/module_file.h), on the first call, and
/// looks up a function in it.
/// @return never null @throws Error naming the file when it cannot be loaded
void* torch_module_entry(const char* function);

}  // namespace anigen
