#pragma once
// Ctrl-C (SIGINT) and SIGTERM ask a command to come to an end; a second one ends it at once.

namespace atomcam {

void catch_interrupts();
bool interrupted();

}  // namespace atomcam
