"""A picture that grows while one watches: what is drawn and what keys do, and the window that shows it."""
