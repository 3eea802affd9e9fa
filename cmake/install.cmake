include(GNUInstallDirs)
install(TARGETS lightrig lightrigd RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
install(DIRECTORY config/ DESTINATION ${CMAKE_INSTALL_DATADIR}/lightrig/config
        FILES_MATCHING PATTERN "*.toml" PATTERN "faulty" EXCLUDE)
