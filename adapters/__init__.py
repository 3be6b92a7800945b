"""The dataset layouts that ship, a folder each. They see only the names of `import rpaug`, as a third party's do."""
