"""The dataset layouts that ship. They see only `import rpaug`, as a third party's do."""
