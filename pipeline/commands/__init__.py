"""The commands of ``fmd``, a module each or a few; `pipeline.cli` loads the one that is called for."""
