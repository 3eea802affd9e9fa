#include "cli/command_line.h"

int main(int argc, char** argv) { return lightrig::cli::run(argc, argv); }
