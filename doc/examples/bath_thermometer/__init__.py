"""A kind of one's own: a thermometer in a stirred bath, held against the bath's temperature."""
