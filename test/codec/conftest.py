"""The contents that the tests of bags use as well."""

from bags.conftest import contents as contents
